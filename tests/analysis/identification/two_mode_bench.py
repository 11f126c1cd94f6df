"""A foreign bench of two modes whose first has a spring that hardens; integrated here by small steps of its own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from campaigns.log import LogWriter
from sim_backend.bench import Signal

Array = NDArray[np.float64]

RATE_HZ = 1000.0
FREQUENCIES_HZ = np.array([10.41, 90.7])
STEPS = 4
"""Steps of the integration per sample: the faster mode turns by 0.14 rad in one."""

NOISE = 1e-3


def play(cubic: float, seed: int, samples: int, frequencies_hz: Array = FREQUENCIES_HZ) -> tuple[Array, Array]:
    """Return drive and reading (samples,) under low-pass noise; `cubic` is the hardening over the inertia."""
    rng = np.random.default_rng(seed)
    u = 3.0 * scipy.signal.lfilter([0.1], [1.0, -0.9], rng.standard_normal(samples))
    omega, zeta, gain = 2.0 * np.pi * frequencies_hz, np.array([0.03, 0.01]), np.array([1.0, 20.0])
    x, v, y, h = np.zeros(2), np.zeros(2), np.empty(samples), 1.0 / RATE_HZ / STEPS
    for k in range(samples):
        y[k] = x.sum()
        for _ in range(STEPS):
            force = gain * u[k] - omega**2 * x - 2.0 * zeta * omega * v
            force[0] -= cubic * x[0] ** 3
            v = v + h * force
            x = x + h * v
    return u, y + NOISE * y.std() * rng.standard_normal(samples)


def write(path: Path, u: Array, y: Array, parts: Sequence[tuple[str, int, int]], **settings: int) -> Path:
    """Write a log of segments (label, first sample, last sample + 1) of a bench that has no delay."""
    channels = [Signal("u", "N m", "input", "tilt", RATE_HZ), Signal("y", "rad", "output", "tilt", RATE_HZ)]
    with LogWriter.create(path, channels, test="t", bench={"kind": "file", "name": "other"}) as log:
        for label, start, stop in parts:
            with log.segment(label, settings):
                log.append({"u": u[start:stop], "y": y[start:stop]})
    return path
