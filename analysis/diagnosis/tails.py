"""How likely a statistic is at least so large by chance.

From scipy.special: scipy.stats has the same functions, and takes a second of every diagnosis to be imported. Arguments
may be arrays; nothing below zero is unlikely.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from sim_backend.linear import Array


def chi2_tail(statistic: Array | float, dof: float) -> Any:
    """Return the chance that a sum of squares of `dof` unit normals is at least `statistic`, any shape."""
    return scipy.special.chdtrc(dof, np.maximum(statistic, 0.0))


def chi2_limit(chance: float, dof: float) -> float:
    """Return what a sum of squares of `dof` unit normals exceeds by this chance."""
    return float(scipy.special.chdtri(dof, chance))


def f_tail(ratio: Array | float, dof: Array | float, other_dof: Array | float) -> Any:
    """Return the chance that a ratio of mean squares with these degrees of freedom is at least `ratio`, any shape."""
    return scipy.special.fdtrc(dof, other_dof, np.maximum(ratio, 0.0))


def normal_tail(deviation: float) -> float:
    """Return the chance that a unit normal number is at least `deviation`."""
    return float(scipy.special.ndtr(-deviation))
