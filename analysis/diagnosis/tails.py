"""How likely a statistic is at least so large by chance, and between what a share may be.

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


def share_interval(hits: int, n: int, level: float = 0.95) -> tuple[float, float]:
    """Return the exact interval of a share of `hits` in `n`; (0, 1) when there is nothing to count.

    Source: C. J. Clopper and E. S. Pearson, Biometrika 26 (1934).
    """
    if n == 0:
        return 0.0, 1.0
    tail = (1.0 - level) / 2.0
    low = float(scipy.special.betaincinv(hits, n - hits + 1, tail)) if hits else 0.0
    high = float(scipy.special.betainccinv(hits + 1, n - hits, tail)) if hits < n else 1.0
    return low, high
