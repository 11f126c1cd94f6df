"""A line that is elsewhere at the start of each run: one frequency and one size for all, a phase for each."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.nominal.responses import simulate
from analysis.diagnosis.pipeline import Options, search_causes
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from sim_backend.effects import EFFECTS
from sim_backend.effects.vibration_line import VibrationLine
from sim_backend.linear import discretise
from tests.analysis.diagnosis.residuals import MODEL, RATE_HZ, RESONANCE_HZ

FREQUENCY_HZ, SIZE, NOISE = 0.0373 * RATE_HZ, 0.05, 0.01
PHASES, ROWS, PERIOD = (0.3, 2.9, 4.4), (6000, 4000, 8000), 1000


def _data(size: float = SIZE, seed: int = 8) -> Dataset:
    """Return three runs of a periodic force, each shaken from another phase on."""
    rng = np.random.default_rng(seed)
    plant, records = discretise(MODEL.linear(), RATE_HZ), []
    for k, (phase, rows) in enumerate(zip(PHASES, ROWS, strict=True)):
        force = np.tile(rng.standard_normal(PERIOD), rows // PERIOD)[:, None]
        # the middle of each sample, in which a held torque is what the wave is on the average
        at = (np.arange(rows) + 0.5) / RATE_HZ
        line = size * np.cos(2.0 * np.pi * FREQUENCY_HZ * at + phase)[:, None]
        reading = simulate(plant, force + line) + NOISE * rng.standard_normal((rows, 1))
        records.append(Record(f"run {k}", force, reading, (Window("all", 0, rows, period=PERIOD),)))
    return Dataset(RATE_HZ, tuple(records))


def test_its_frequency_and_size_are_right_although_no_phase_serves_all() -> None:
    others = tuple(e.reported() for e in EFFECTS if e is not VibrationLine)
    found = search_causes(_data(), MODEL, Options(without=others)).best
    assert [e.name for e in found.effects] == ["vibration-line"]
    values = {name: value for (_, name), value in zip(found.names, found.values, strict=True)}
    std = {name: value for (_, name), value in zip(found.names, found.std, strict=True)}
    # three deviations: one in four hundred by chance
    assert abs(values["frequency_hz"] - FREQUENCY_HZ) < 3.0 * std["frequency_hz"]
    assert np.hypot(values["cosine"], values["sine"]) == pytest.approx(SIZE, abs=3.0 * max(std["cosine"], std["sine"]))
    # a phase per run known as well as the record allows: with one for all, two of three would be left in the residual
    assert found.misfit / found.rows < 1.0 + 4.0 * np.sqrt(2.0 / found.rows) + 0.02
    assert found.effects[0].chosen() == 2


def test_a_weak_line_pays_for_what_its_phases_are_known_to() -> None:
    """Eight standard deviations in all: two phases cost 5 in the logarithm of the evidence, not 10 by all rows."""
    others = tuple(e.reported() for e in EFFECTS if e is not VibrationLine)
    answer = abs(1.0 / (1.0 - (FREQUENCY_HZ / RESONANCE_HZ) ** 2))  # above the resonance, where damping is little
    data = _data(size=8.0 * np.sqrt(2.0 / sum(ROWS)) * NOISE / answer)
    assert [e.name for e in search_causes(data, MODEL, Options(without=others)).best.effects] == ["vibration-line"]


def test_noise_is_no_line() -> None:
    others = tuple(e.reported() for e in EFFECTS if e is not VibrationLine)
    for seed in range(20, 26):
        assert not search_causes(_data(0.0, seed), MODEL, Options(without=others)).best.effects
