"""Readings on a lattice: the step is found to the last place, and nothing is found where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.records.lattice import Lattice, lattice_of
from analysis.diagnosis.search.shortlist import Rules
from analysis.diagnosis.variance.quantisation import rounded_readings
from sim_backend.effects.cubic_stiffness import CubicStiffness
from sim_backend.effects.periodic_sensor_error import PeriodicSensorError
from tests.analysis.diagnosis.residuals import setting_of


@pytest.mark.parametrize("step", [3.7e-9, 2.0**-20, 1e-3])
@pytest.mark.parametrize("spread", [0.6, 300.0, 2e6])
def test_the_step_of_rounded_numbers_is_found(step: float, spread: float) -> None:
    """Also where the steps that occur lie far apart, and where hardly any of them occurs."""
    x = np.random.default_rng(1).standard_normal(50_000) * spread * step
    found = lattice_of(step * np.rint(x / step))
    assert found is not None
    # products k q are rounded to their last place, 1e-16 of at most 5 spread steps
    assert found.step == pytest.approx(step, rel=1e-15 * max(5.0 * spread, 1.0))
    assert found.log_p < -10.0


def test_a_lattice_may_lie_beside_zero_and_in_other_units() -> None:
    """Counts of a converter are shifted by an offset and multiplied by a calibration."""
    counts = np.round(np.random.default_rng(2).standard_normal(20_000) * 100.0)
    found = lattice_of((counts - 3217.4) * 1.2345e-7)
    assert found is not None
    assert found.step == pytest.approx(1.2345e-7, rel=1e-9)


@pytest.mark.parametrize("digits", [5, 6, 8, 10])
def test_steps_are_found_in_what_text_has_kept_of_them(digits: int) -> None:
    """Of 0.2 rad five digits keep 1e-5 at most: a twentieth of the step, and every gap is off by as much."""
    step = 2.368e-4
    x = np.random.default_rng(6).standard_normal(12_000) * 0.02
    written = np.array([float(f"{value:.{digits}g}") for value in step * np.rint(x / step)])
    found = lattice_of(written)
    assert found is not None
    assert found.step == pytest.approx(step, abs=3.0 * found.std)
    assert found.std < 1e-3 * step


def test_numbers_off_a_lattice_are_none() -> None:
    """Of 100 sets of continuous numbers none; one number off the lattice is enough to break it."""
    rng = np.random.default_rng(3)
    assert all(lattice_of(rng.standard_normal(2000) * 1e-6) is None for _ in range(100))
    rounded = np.round(rng.standard_normal(2000), 2)
    rounded[77] += 0.01 / np.pi
    assert lattice_of(rounded) is None


def test_a_step_counts_by_what_it_does_to_the_readings() -> None:
    """`shift` is the root of rows · step² / 12 over the noise's variance, `allowed` one row's share."""
    rng = np.random.default_rng(4)
    noise = rng.standard_normal(12_000)
    reading = 0.25 * np.rint((np.sin(np.arange(12_000) / 50.0) * 40.0 + noise) / 0.25)
    (cause,) = rounded_readings(setting_of(np.zeros(12_000), reading, noise, 1.0)[0])
    assert cause.effect.name == "sensor-quantisation"
    assert cause.shift == pytest.approx(np.sqrt(12_000 * 0.25**2 / 12.0))
    assert cause.allowed == pytest.approx(0.25**2 / 12.0)
    single = (reading + noise / 7.0).astype(np.float32).astype(float)
    far = rounded_readings(setting_of(np.zeros(12_000), single, noise, 1.0)[0])
    # numbers of single precision are all multiples of a last place, which moves nothing
    assert all(c.shift < 1e-3 for c in far)


@pytest.mark.parametrize(
    ("period", "where", "is_it"), [(2e-3, "x", True), (1e-3, "x", True), (4e-3, "x", False), (2e-3, "y", False)]
)
def test_an_error_that_repeats_with_the_steps_is_their_rounding(period: float, where: str, is_it: bool) -> None:
    rules = Rules((), 0.002, 3, 4, 0, lattices={"x": Lattice(2e-3, 1e-9, -50.0)})
    assert rules.is_rounding(Candidate(PeriodicSensorError, where, {"period": period}, {}, {})) == is_it
    assert not rules.is_rounding(Candidate(CubicStiffness, where, {}, {}, {}))
