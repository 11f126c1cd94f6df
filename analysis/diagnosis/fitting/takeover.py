"""What an effect on the model takes over from the knobs that stood in for it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import fields

import numpy as np
import scipy

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.nominal.prior import strain_of
from analysis.diagnosis.nominal.tuning import imitation, turned
from sim_backend.assembly import retuned
from sim_backend.errors import ConfigError
from sim_backend.linear import Array


def taken_over(setting: Setting, fit: Fit, candidate: Candidate, sizes: Array) -> tuple[Array, bool]:
    """Return the knobs when an effect on the model does what they did in its place, and whether nothing else changes.

    Raises ConfigError where there is no such effect.
    """
    linear, units = turned(setting.nominal, setting.knobs, fit.change), candidate.unit_sizes
    effect = candidate.made(dict(zip(units, sizes * np.array(list(units.values())), strict=True)))
    start = fit.change - imitation(linear, setting.knobs, retuned(linear, [effect], setting.places))
    made = retuned(turned(setting.nominal, setting.knobs, start), [effect], setting.places)
    same = made.n_blocks == linear.n_blocks and all(
        np.allclose(getattr(made, f.name), getattr(linear, f.name), rtol=1e-9, atol=0.0) for f in fields(linear)
    )
    return start, same


def part_to_take(setting: Setting, fit: Fit, candidate: Candidate, sizes: Array) -> float:
    """Return the part of its screened sizes that an effect begins with.

    Where knobs and effect can share in any proportion and the data see no difference, the nominal model decides: the
    part that leaves the knobs least to do. A descent would have to find it along a narrow, bent valley.
    """
    if not taken_over(setting, fit, candidate, sizes)[1]:
        return 1.0

    def left(part: float) -> float:
        with suppress(ConfigError):
            return strain_of(setting.knobs, taken_over(setting, fit, candidate, part * sizes)[0])
        return np.inf

    found = scipy.optimize.minimize_scalar(left, bounds=(0.0, 2.0), method="bounded")
    return float(found.x) if found.fun < left(1.0) else 1.0
