"""A process of its own that plays a mirror with a torque no library lists, and writes what was recorded as columns.

`python -m tests.end_to_end.strange_bench FILE STRENGTH`: one mode at 24 Hz, and a torque -strength |x| sin(v / v0) that
damps slow motion and drives fast one. It shares no code with the product.
"""

from __future__ import annotations

import math
import sys

import numpy as np

RATE_HZ, PERIOD, PERIODS, FINER = 1000.0, 1000, 3, 4
LEVELS = (0.4, 1.0, 0.7)
"""Sizes of the three multisines; the last one is held out."""
FREQUENCY_HZ, DECAY_1_S, FAST = 24.0, 7.0, 120.0
NOISE = 2e-3


def multisines(rng: np.random.Generator) -> np.ndarray:
    """Return the drive (n,): a multisine of 79 lines at each level, repeated."""
    parts = []
    for level in LEVELS:
        spectrum = np.zeros(PERIOD // 2 + 1, dtype=complex)
        spectrum[1:80] = np.exp(2j * math.pi * rng.random(79))
        wave = np.fft.irfft(spectrum, PERIOD)
        parts.append(np.tile(0.6 * level * wave / wave.std(), PERIODS))
    return np.concatenate(parts)


def play(strength: float, seed: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Return drive and reading (n,), by the classical Runge-Kutta rule, four steps to a sample."""
    rng, omega = np.random.default_rng(seed), 2.0 * math.pi * FREQUENCY_HZ
    u = multisines(rng)

    def rate(x: float, v: float, drive: float) -> float:
        return omega**2 * (drive - x - strength * abs(x) * math.sin(v / FAST)) - 2.0 * DECAY_1_S * v

    y, x, v, h = np.zeros(u.size), 0.0, 0.0, 1.0 / RATE_HZ / FINER
    for k, drive in enumerate(u.tolist()):
        y[k] = x
        for _ in range(FINER):
            a1 = rate(x, v, drive)
            v2 = v + 0.5 * h * a1
            a2 = rate(x + 0.5 * h * v, v2, drive)
            v3 = v + 0.5 * h * a2
            a3 = rate(x + 0.5 * h * v2, v3, drive)
            v4 = v + h * a3
            a4 = rate(x + h * v3, v4, drive)
            x, v = x + h * (v + 2.0 * v2 + 2.0 * v3 + v4) / 6.0, v + h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0
    return u, y + NOISE * rng.standard_normal(y.size)


if __name__ == "__main__":
    np.savetxt(sys.argv[1], np.stack(play(float(sys.argv[2])), axis=1), delimiter=",", header="u,y", comments="")
