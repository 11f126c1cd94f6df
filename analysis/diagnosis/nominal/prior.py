"""What is known of the nominal model's numbers before the data speak: how far knobs may be turned, and how together.

Every number that a model states is wrong by a part of its own, independent of all others. Of a mode's participations
only products of an input's and an output's matter, so the largest output participation c₀ is held as it is, and the
knobs of the others stand for b c₀ and c / c₀: ln b moves by ε_b + ε_0 and ln c by ε_c - ε_0. So the unknown error ε_0
of what is held is in all of them, which a knob's `loading` says: drives of one mode are wrong alike, and an output
against the drives. Were they taken as independent, one sensor whose numbers happen to be all too small would be a gain
of that sensor at several standard deviations.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from analysis.diagnosis.nominal.tuning import Knob
from sim_backend.linear import Array


def covariance_of(knobs: Sequence[Knob]) -> Array:
    """Return the covariance (n, n) of the knobs' changes, each on its own scale."""
    loading, mode = np.array([k.loading for k in knobs]), np.array([k.mode for k in knobs])
    together = np.outer(loading, loading) * (mode[:, None] == mode)
    return np.asarray(np.diag(np.array([k.sd for k in knobs]) ** 2) + together)


def spreads_of(knobs: Sequence[Knob]) -> Array:
    """Return the standard deviation (n,) of each knob's change by itself."""
    return np.sqrt(np.diag(covariance_of(knobs)))


def root_of(knobs: Sequence[Knob]) -> Array:
    """Return W (n, n) that makes unit white numbers of the knobs' changes: W'W is the inverse of their covariance."""
    return np.asarray(scipy.linalg.solve_triangular(factor_of(knobs), np.eye(len(knobs)), lower=True))


def factor_of(knobs: Sequence[Knob]) -> Array:
    """Return the lower factor U (n, n) of the covariance U U'."""
    return np.asarray(np.linalg.cholesky(covariance_of(knobs)))


def strain_of(knobs: Sequence[Knob], change: Array) -> float:
    """Return how far a change (n,) of the knobs is off: the sum of its squares in units of what is plausible."""
    return float(np.sum((root_of(knobs) @ change) ** 2))
