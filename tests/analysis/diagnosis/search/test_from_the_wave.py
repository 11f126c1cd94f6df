"""A reading that was rounded before slow noise came to it, on an axis that nothing holds."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from analysis.diagnosis.api import diagnose
from sim_backend.model import Mode, Model, Port

RATE_HZ, N, STEPS = 500.0, 6000, 2000
DRAG_1_S = 2.0


def free_axis() -> Model:
    """Return a mass of 1 kg with drag, from force to displacement."""
    return Model(
        name="free",
        sample_rate_hz=RATE_HZ,
        inputs=[Port(name="force", unit="N", dof="x")],
        outputs=[Port(name="x", unit="m", dof="x")],
        modes=[
            Mode(label="x", frequency_hz=0.0, decay_rate_1_s=0.5 * DRAG_1_S, input={"force": 1.0}, output={"x": 1.0})
        ],
    )


def moved(force: np.ndarray) -> np.ndarray:
    """Return the displacement (n,) of the mass under a held force (n,), from an unknown place."""
    held = np.exp(-DRAG_1_S / RATE_HZ)
    x, v, out = 3.4e-3, 0.0, np.empty(force.size)
    for k, f in enumerate(force.tolist()):
        out[k] = x
        end = f / DRAG_1_S
        x += end / RATE_HZ + (v - end) * (1.0 - held) / DRAG_1_S
        v = end + (v - end) * held
    return out


@pytest.mark.parametrize("rounded", [True, False])
def test_steps_beneath_slow_noise_are_no_wave_on_a_free_axis(rounded: bool) -> None:
    """A wave has a phase of its own and explains six tenths of a sawtooth; the axis may begin anywhere in a step."""
    rng = np.random.default_rng(5)
    u = scipy.signal.sosfilt(scipy.signal.butter(2, 0.02, output="sos"), rng.standard_normal(N))
    u *= 0.5 / u.std()
    x = moved(u)
    step = np.ptp(x) / STEPS
    wave = 0.5 * step * np.sin(2.0 * np.pi * x / step + 1.0)
    slow = scipy.signal.lfilter([1.0], [1.0, -0.995], rng.standard_normal(N))
    y = np.where(rounded, step * np.round(x / step), x + wave) + 0.03 * step * slow
    found = diagnose(u, y, RATE_HZ, free_axis())
    names = [cause.effect for cause in found.causes]
    assert (found.verdict, names) == ("named", ["sensor-quantisation" if rounded else "periodic-sensor-error"])
