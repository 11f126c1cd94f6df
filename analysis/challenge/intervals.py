"""Intervals of 95 %: of quantiles exactly, of medians by resampling; and where half is detected."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEVEL = 0.95
_RESAMPLES = 2000


def quantile_interval(values: Sequence[float], part: float) -> tuple[float, float] | None:
    """Return the exact interval of what `part` of all values lie below, whatever they are distributed like.

    Its ends are two of the values, as many as `part` of a sample may lie below by chance; None when there are too few.
    Source: H. A. David and H. N. Nagaraja, Order Statistics (2003), section 7.1.
    """
    n, tail, ordered = len(values), (1.0 - LEVEL) / 2.0, sorted(values)
    below = scipy.stats.binom.cdf(np.arange(n), n, part)  # chance that at most so many values lie below the quantile
    low = int(np.searchsorted(below, tail, side="right")) - 1
    high = int(np.searchsorted(below, 1.0 - tail))
    return (ordered[low], ordered[high]) if low >= 0 and high < n else None


def bootstrap_interval(
    groups: Sequence[Array], statistic: Callable[[Array], float], rng: np.random.Generator
) -> tuple[float, float]:
    """Return the percentile interval of a statistic of all numbers, resampling whole `groups`.

    Each group (n,) holds the numbers of one case; not-a-number without groups.
    """
    if not groups:
        return float("nan"), float("nan")
    drawn = rng.integers(len(groups), size=(_RESAMPLES, len(groups)))
    values = [statistic(np.concatenate([groups[i] for i in row])) for row in drawn]
    low, high = np.quantile(values, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0])
    return float(low), float(high)


def half_points(sizes: Sequence[Array], seen: Sequence[NDArray[np.bool_]]) -> Array:
    """Return, per group, the size at which half is seen, shape (groups,).

    The chance of seeing size s is Φ(slope · ln(s / s_half)), with one slope for all groups. A weak normal prior on ln
    s_half (mean 0, deviation 2) and on ln slope (mean 1, deviation 1) keeps groups finite in which all or nothing was
    seen.
    """
    n = len(sizes)

    def cost(x: Array) -> float:
        slope = np.exp(x[n])
        total = float(np.sum((x[:n] / 2.0) ** 2) / 2.0 + (x[n] - 1.0) ** 2 / 2.0)
        for at, s, hit in zip(x[:n], sizes, seen, strict=True):
            z = slope * (np.log(s) - at)
            total -= float(np.sum(scipy.stats.norm.logcdf(np.where(hit, z, -z))))
        return total

    start = np.zeros(n + 1)
    start[n] = 1.0
    return np.asarray(np.exp(scipy.optimize.minimize(cost, start, method="L-BFGS-B").x[:n]))
