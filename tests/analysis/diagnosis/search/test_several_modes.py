"""Modes that a model lacks: each is found at its own frequency, however many there are of the one kind."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from analysis.diagnosis.pipeline import Options, diagnose
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from analysis.diagnosis.search.shortlist import MOST, Rules
from sim_backend.effects import EFFECTS, effect_class
from sim_backend.model import Mode, Model, Port

RATE_HZ, PERIOD = 2000.0, 2000
MISSING_HZ = {95.0: (0.05, 0.01), 240.0: (0.2, 0.015)}
"""Frequency: residue over that of the known mode, damping ratio."""


def played(rng):
    """Return drive and reading (n,) of three modes in parallel, by scipy: three periods, another two held out."""
    spectrum = np.zeros((2, PERIOD // 2 + 1), complex)
    spectrum[:, 2:800] = np.exp(2j * np.pi * rng.random((2, 798)))
    waves = np.fft.irfft(spectrum, PERIOD)
    waves *= [[1.0], [0.6]] / waves.std(axis=1, keepdims=True)
    u = np.concatenate([np.tile(waves[0], 4), np.tile(waves[1], 3)])
    y = np.zeros(u.size)
    for frequency_hz, (part, ratio) in ({30.0: (1.0, 0.03)} | MISSING_HZ).items():
        omega = 2.0 * np.pi * frequency_hz
        system = ([part], [1.0, 2.0 * ratio * omega, omega**2])
        b, a, _ = cont2discrete(system, 1.0 / RATE_HZ, method="zoh")
        y += lfilter(b[0], a, u)
    return u, y + 1e-3 * y.std() * rng.standard_normal(u.size)


def test_two_missing_modes_are_named_at_their_frequencies():
    u, y = played(np.random.default_rng(4))
    windows = (Window("fit", 0, 4 * PERIOD, period=PERIOD), Window("held-out", 4 * PERIOD, y.size, True, PERIOD))
    model = Model(
        name="one mode",
        sample_rate_hz=RATE_HZ,
        inputs=[Port(name="u", unit="N m", dof="theta_x")],
        outputs=[Port(name="y", unit="rad", dof="theta_x")],
        modes=[Mode(label="30 Hz", frequency_hz=30.0, decay_rate_1_s=5.65, input={"u": 1.0}, output={"y": 1.0})],
    )
    data = Dataset(RATE_HZ, (Record("played", u[:, None], y[:, None], windows),))
    found = diagnose(data, model, Options())
    assert found.verdict == "named", found.sentence
    assert [c.effect for c in found.causes] == ["extra-resonance"] * 2
    by_hz = sorted((c.parameters for c in found.causes), key=lambda p: p["frequency_hz"].value)
    for parameters, (frequency_hz, (part, ratio)) in zip(by_hz, MISSING_HZ.items(), strict=True):
        truth = {"frequency_hz": frequency_hz, "participation": part, "damping_ratio": ratio}
        for name, value in truth.items():
            # four stated deviations, once in 16 000 beyond them by chance
            assert abs(parameters[name].value - value) < 4.0 * parameters[name].std, name
    assert found.gain is not None and found.gain.rms_after < 1.05 * found.gain.noise_floor


@pytest.mark.parametrize(
    ("found", "may"),
    [
        ((), {"hysteresis", "extra-resonance", "delay"}),
        (("extra-resonance",) * 2, {"hysteresis", "extra-resonance", "delay"}),
        (("extra-resonance", "extra-resonance", "hysteresis", "delay"), {"extra-resonance"}),
        (("hysteresis", "delay", "backlash"), set()),
        (("extra-resonance",) * MOST, set()),
    ],
)
def test_modes_count_once_among_the_effects_that_a_search_may_find(found, may):
    rules = Rules(EFFECTS, 0.002, 3, 4, 0)
    allowed = {e.name for e in rules.beside([effect_class(name) for name in found])}
    assert allowed & {"hysteresis", "extra-resonance", "delay"} == may
