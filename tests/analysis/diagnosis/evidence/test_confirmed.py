"""What stands beside a right cause on fitted rows alone is no cause, however much both together gain."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.evidence.confirmed import confirmed
from analysis.diagnosis.pipeline import Options, diagnose, found_with_variance_effects
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from analysis.diagnosis.search.stage import silent
from tests.analysis.diagnosis.residuals import MODEL, RATE_HZ, moved

N, NOISE_M, ZONE_N, ERROR_M, PERIOD_M = 8000, 1e-6, 1e-4, 2e-5, 0.02


def record_of(name: str, error_m: float, *, held_out: bool, seed: int, zone_n: float = ZONE_N) -> Record:
    """Return a record of the oscillator whose drive has a dead zone, and whose sensor errs by a wave of the reading."""
    rng = np.random.default_rng(seed)
    force = 0.1 * np.repeat(rng.normal(size=N // 20), 20)
    position = moved(np.sign(force) * np.maximum(np.abs(force) - zone_n, 0.0))
    reading = position + error_m * np.sin(2.0 * np.pi * position / PERIOD_M) + NOISE_M * rng.standard_normal(N)
    return Record(name, force[:, None], reading[:, None], (Window(name, 0, N, held_out, 0),))


@pytest.mark.parametrize(
    ("error_on_held_out_m", "kept"),
    [(ERROR_M, {"dead-zone", "periodic-sensor-error"}), (-ERROR_M, {"dead-zone"})],
)
def test_what_only_the_fitted_rows_have_goes_and_what_all_have_stays(
    error_on_held_out_m: float, kept: set[str]
) -> None:
    fitted = record_of("fitted", ERROR_M, held_out=False, seed=1)
    data = Dataset(RATE_HZ, (fitted, record_of("held out", error_on_held_out_m, held_out=True, seed=2)))
    found, _ = found_with_variance_effects(data.for_fitting(), MODEL, Options(workers=1), silent)
    assert {e.name for e in found.best.effects} == {"dead-zone", "periodic-sensor-error"}
    assert {e.name for e in confirmed(found, data).best.effects} == kept


def test_the_name_of_a_lone_cause_falls_by_the_gain_as_a_whole() -> None:
    """It stays in the answer until then: the verdict is *unknown*, for what was found is there."""
    fitted = record_of("fitted", ERROR_M, held_out=False, seed=3, zone_n=0.0)
    held_out = record_of("held out", -ERROR_M, held_out=True, seed=4, zone_n=0.0)
    diagnosis = diagnose(Dataset(RATE_HZ, (fitted, held_out)), MODEL, Options(workers=1))
    assert diagnosis.verdict == "unknown" and diagnosis.causes == ()
    assert any("times as large" in note or "worse than the model without it" in note for note in diagnosis.notes)
