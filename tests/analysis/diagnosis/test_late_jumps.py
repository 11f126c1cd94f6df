"""Commands that jump, and come in within a sample: what a slow axis answers is simulated as exactly as a fast one."""

from __future__ import annotations

import numpy as np

from analysis.diagnosis.api import diagnose
from sim_backend.model import Model
from tests.analysis.diagnosis.two_axes import two_axes

RATE_HZ, FINE = 4000.0, 100
LATE = 0.57
AXES = {"x": 390.0, "y": 11.0}
DAMPING, NOISE = 0.05, 1e-4


def bench() -> Model:
    """Return a fast and a slow axis of unit DC gain whose commands come in within a sample."""
    decay_1_s = {axis: 2.0 * np.pi * hz * DAMPING for axis, hz in AXES.items()}
    return two_axes(AXES, decay_1_s, RATE_HZ, LATE / RATE_HZ)


def moved(force: np.ndarray, frequency_hz: float) -> np.ndarray:
    """Return the displacement (n,) under a held force that comes in late, by the exact solution over a hundredth."""
    omega = 2.0 * np.pi * frequency_hz
    decay, dt = DAMPING * omega, 1.0 / (RATE_HZ * FINE)
    turn = np.sqrt(omega**2 - decay**2)
    step = np.exp((-decay + 1j * turn) * dt)
    late, z, out = round(LATE * FINE), 0j, np.empty(force.size)
    for k in range(force.size):
        out[k] = z.imag
        for part in range(FINE):
            acting = force[k] if part >= late else force[k - 1] if k else 0.0
            # z turns about the point at which this force would hold it
            rest = acting * omega**2 / turn / (decay - 1j * turn)
            z = rest + (z - rest) * step
    return out


def test_nothing_is_missing_where_jumps_come_in_within_a_sample() -> None:
    """An error of a thousandth of what jumps do would be ten times the noise: spread over samples, they made that."""
    rng = np.random.default_rng(12)
    u = rng.standard_normal((3000, 2))
    y = np.stack([moved(u[:, i], hz) for i, hz in enumerate(AXES.values())], axis=1)
    y += NOISE * y.std(axis=0) * rng.standard_normal(y.shape)
    found = diagnose(u, y, RATE_HZ, bench())
    assert (found.verdict, found.causes) == ("consistent", ()), found.sentence
    (left,) = found.after
    assert np.all(np.std(left, axis=0) < 1.1 * NOISE * y.std(axis=0))
