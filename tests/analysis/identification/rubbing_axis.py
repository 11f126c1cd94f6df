"""A rigid axis that rubs, in a position loop, integrated by formulas of its own: nothing comes from the product."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

MASS, DAMPING, FRICTION, CONSTANT = 2.7, 5.8, 0.58, -0.09
"""In units of the drive (V): per m/s², per m/s, against the motion, and always."""

RATE_HZ = 500.0
NOISE_M = 2e-6


def play(seconds: float, seed: int, friction: float = FRICTION) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return drive and reading (n,): trapezoidal moves of changing size under a proportional-derivative loop."""
    rng = np.random.default_rng(seed)
    n, dt = int(seconds * RATE_HZ), 1.0 / RATE_HZ
    acceleration = np.zeros(n)
    move = int(1.5 * RATE_HZ)
    for i, start in enumerate(range(0, n, move)):
        size = (-1.0) ** i * rng.uniform(0.15, 0.6)
        for sign, part in ((1.0, 0.1), (-1.0, 0.5)):
            first = start + int(part * move)
            acceleration[first : first + int(0.25 * move)] = sign * size
    reference = np.cumsum(np.cumsum(acceleration)) * dt**2
    x, v, filtered, last = 0.0, 0.0, 0.0, 0.0
    u, y = np.zeros(n), np.zeros(n)

    def pull(drive: float, speed: float) -> float:
        return (drive - DAMPING * speed - friction * np.tanh(speed / 1e-3) - CONSTANT) / MASS

    for k in range(n):
        y[k] = x + NOISE_M * rng.standard_normal()
        filtered += 0.3 * ((y[k] - last) * RATE_HZ - filtered)
        last = y[k]
        u[k] = np.clip(60.0 * (reference[k] - y[k]) - 12.0 * filtered, -10.0, 10.0)
        for _ in range(8):  # midpoint rule; the drive is held
            half = v + 0.5 * dt / 8 * pull(u[k], v)
            x, v = x + dt / 8 * half, v + dt / 8 * pull(u[k], half)
    return u, y
