"""A vibration does not wait for a run: in a held-out one it is in another phase, and it is named all the same."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.pipeline import Options, diagnose
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from tests.analysis.diagnosis.residuals import MODEL, RATE_HZ, moved

N, NOISE_M, FORCE_N, FREQUENCY_HZ = 6000, 1e-6, 1e-4, 23.7


def record_of(name: str, force_n: float, phase: float, *, held_out: bool, seed: int) -> Record:
    """Return a record of the oscillator, driven by steps and shaken at one frequency."""
    rng = np.random.default_rng(seed)
    force = 0.1 * np.repeat(rng.normal(size=N // 20), 20)
    shaken = force_n * np.cos(2.0 * np.pi * (FREQUENCY_HZ * np.arange(N) / RATE_HZ + phase))
    reading = moved(force + shaken) + NOISE_M * rng.standard_normal(N)
    return Record(name, force[:, None], reading[:, None], (Window(name, 0, N, held_out, 0),))


@pytest.mark.parametrize("phase", [0.0, 0.4])
def test_its_phase_in_a_held_out_run_may_be_any(phase: float) -> None:
    fitted = record_of("fitted", FORCE_N, 0.1, held_out=False, seed=1)
    held_out = record_of("held out", FORCE_N, 0.1 + phase, held_out=True, seed=2)
    diagnosis = diagnose(Dataset(RATE_HZ, (fitted, held_out)), MODEL, Options(workers=1))
    assert diagnosis.verdict == "named" and [c.effect for c in diagnosis.causes] == ["vibration-line"]
    assert diagnosis.gain is not None and diagnosis.gain.rms_after < 0.5 * diagnosis.gain.rms_before


def test_one_that_a_held_out_run_does_not_have_makes_it_worse_in_any_phase() -> None:
    fitted = record_of("fitted", FORCE_N, 0.1, held_out=False, seed=3)
    diagnosis = diagnose(
        Dataset(RATE_HZ, (fitted, record_of("held out", 0.0, 0.0, held_out=True, seed=4))), MODEL, Options(workers=1)
    )
    assert diagnosis.verdict == "unknown" and diagnosis.causes == ()
