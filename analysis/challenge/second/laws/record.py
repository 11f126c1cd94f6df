"""Laws of the record: what is written down differs from what was read. The controller saw the true reading."""

from __future__ import annotations

import numpy as np

from analysis.challenge.second.law import Array, law

_PART = "record"


def between(y: Array, v: Array, rate_hz: float, late: Array) -> Array:
    """Return positions `late` (n,) samples after each sample, by cubics through positions and rates (n,)."""
    n = y.size
    at = np.clip(np.arange(n) + late, 0.0, n - 1.0)
    k = np.minimum(at.astype(int), n - 2)
    s, h = at - k, 1.0 / rate_hz
    value = (1 + 2 * s) * (1 - s) ** 2 * y[k] + s * (1 - s) ** 2 * h * v[k]
    return np.asarray(value + s**2 * (3 - 2 * s) * y[k + 1] - s**2 * (1 - s) * h * v[k + 1])


@law(
    "off-clock",
    "listed",
    _PART,
    lambda s: 0.2 / (s.rate_hz * s.run_s),
    how="record",
    effect="sample-clock-error",
    parameter="relative",
    cap=20.0,
)
def off_clock(y: Array, v: Array, p: Array, rate_hz: float, rng: np.random.Generator) -> Array:
    """Return positions (n,) by a recorder whose clock runs late by a part `p[0]`."""
    return between(y, v, rate_hz, p[0] * np.arange(y.size, dtype=float))


@law(
    "lost-samples",
    "listed",
    _PART,
    lambda s: 0.05,
    how="record",
    effect="dropped-samples",
    parameter="fraction",
    cap=6.0,
)
def lost_samples(y: Array, v: Array, p: Array, rate_hz: float, rng: np.random.Generator) -> Array:
    """Return positions (n,) of which a share `p[0]` repeats the one before."""
    lost = rng.random(y.size) < p[0]
    kept = np.maximum.accumulate(np.where(lost, 0, np.arange(y.size)))
    return np.asarray(y[kept])


@law(
    "jitter-bursts",
    "unlisted",
    _PART,
    lambda s: 0.3,
    how="record",
    shapes=lambda rng, s: (rng.uniform(0.05, 0.3), rng.uniform(4.0, 12.0)),
    cap=3.0,
)
def jitter_bursts(y: Array, v: Array, p: Array, rate_hz: float, rng: np.random.Generator) -> Array:
    """Return positions (n,) that come late by thirds of `p[0]` samples in `p[2]` bursts, which are a share `p[1]`."""
    n, bursts = y.size, int(p[2])
    burst = np.zeros(n)
    length = max(int(n * p[1] / bursts), 1)
    for start in rng.integers(0, n - length, bursts):
        burst[start : start + length] = 1.0
    return between(y, v, rate_hz, p[0] * burst * rng.integers(0, 4, n) / 3.0)
