"""A process of its own that plays a mirror behind a slow amplifier, and writes what was recorded as columns.

`python -m tests.end_to_end.lagging_bench FILE SECOND CUBIC`: one mode at 24 Hz whose stiffness grows by `CUBIC` times
the square of the position; the amplifier has two lags, the other one `SECOND` times as long. It shares no code with the
product.
"""

from __future__ import annotations

import math
import sys

import numpy as np

from tests.end_to_end.strange_bench import DECAY_1_S, FREQUENCY_HZ, NOISE, RATE_HZ, multisines

FINER, LAG_S = 10, 1e-3


def play(second: float, cubic: float, seed: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """Return drive and reading (n,), by the classical Runge-Kutta rule, ten steps to a sample."""
    rng, omega = np.random.default_rng(seed), 2.0 * math.pi * FREQUENCY_HZ
    u = multisines(rng)

    def rate(s: np.ndarray, drive: float) -> np.ndarray:
        current, torque, x, v = s
        pull = torque if second else current
        return np.array(
            [
                (drive - current) / LAG_S,
                (current - torque) / (second * LAG_S) if second else 0.0,
                v,
                omega**2 * (pull - x - cubic * x**3) - 2.0 * DECAY_1_S * v,
            ]
        )

    y, s, h = np.zeros(u.size), np.zeros(4), 1.0 / RATE_HZ / FINER
    for k, drive in enumerate(u.tolist()):
        y[k] = s[2]
        for _ in range(FINER):
            a1 = rate(s, drive)
            a2 = rate(s + 0.5 * h * a1, drive)
            a3 = rate(s + 0.5 * h * a2, drive)
            a4 = rate(s + h * a3, drive)
            s = s + h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0
    return u, y + NOISE * rng.standard_normal(y.size)


if __name__ == "__main__":
    columns = np.stack(play(float(sys.argv[2]), float(sys.argv[3])), axis=1)
    np.savetxt(sys.argv[1], columns, delimiter=",", header="u,y", comments="")
