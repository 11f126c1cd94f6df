"""What a simulation without noise leaves is the rounding of its numbers, to whatever digits: no noise, and no cause."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
import pytest

from analysis.diagnosis.noise.estimate import whitener_from
from analysis.diagnosis.nominal.responses import simulate
from analysis.diagnosis.pipeline import Options, diagnose
from analysis.diagnosis.records.dataset import FINEST, Dataset, Record, Window
from sim_backend.linear import played
from tests.analysis.diagnosis.two_modes import RATE_HZ, drive, one_axis

PERIOD = 1500


def _record(*, repeats: bool, noise: float = 0.0, softer: float = 1.0) -> Dataset:
    """Return readings of the bench, its first mode `softer`, without more noise than this part of their rms."""
    rng = np.random.default_rng(4)
    u = np.tile(drive(PERIOD, seed=2), (4, 1)) if repeats else drive(4 * PERIOD, seed=2)
    linear = one_axis().linear()
    linear.omega_rad_s[0] *= softer
    y = simulate(played(linear, RATE_HZ), u)
    y = y + noise * np.std(y) * rng.standard_normal(y.shape)
    period = PERIOD if repeats else 0
    windows = (Window("a", 0, 3 * PERIOD, period=period), Window("b", 3 * PERIOD, 4 * PERIOD, held_out=True))
    return Dataset(RATE_HZ, (Record("r", u, y, windows),))


@pytest.mark.parametrize("repeats", [True, False])
def test_no_cause_is_named_in_what_rounding_leaves(repeats: bool) -> None:
    """Rounding grows with the numbers, as noise at a large deflection does; nobody is warned of a logarithm of zero."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        found = diagnose(_record(repeats=repeats), one_axis(), Options(tolerance=0.01, workers=1))
    assert found.verdict == "consistent", found.sentence
    assert not found.causes


@pytest.mark.parametrize("repeats", [True, False])
@pytest.mark.parametrize(
    "written",
    [
        pytest.param(lambda y: np.float32(y).astype(float), id="32 bits"),
        pytest.param(lambda y: np.deg2rad(np.float32(np.rad2deg(y)).astype(float)), id="32 bits in degrees"),
        pytest.param(lambda y: np.char.mod("%.5g", y).astype(float), id="5 digits"),
    ],
)
def test_no_cause_is_named_in_what_few_digits_leave(written: Callable[[np.ndarray], np.ndarray], repeats: bool) -> None:
    """Small numbers have finer steps than large ones: their noise grows with the distance from the centre."""
    (record,) = _record(repeats=repeats).records
    data = Dataset(RATE_HZ, (Record("r", record.u, written(record.y), record.windows),))
    found = diagnose(data, one_axis(), Options(tolerance=0.01, workers=1))
    assert found.verdict == "consistent", found.sentence


@pytest.mark.parametrize("repeats", [True, False])
def test_a_fault_is_seen_where_there_is_no_noise(repeats: bool) -> None:
    """One of a thousandth, a tenth of the tolerance: nothing is wrong with the model that its numbers cannot mend."""
    found = diagnose(_record(repeats=repeats, softer=1.001), one_axis(), Options(tolerance=0.01, workers=1))
    assert found.verdict == "consistent", found.sentence
    assert found.linear.omega_rad_s[0] == pytest.approx(1.001 * one_axis().linear().omega_rad_s[0], rel=1e-6)


@pytest.mark.parametrize("repeats", [True, False])
def test_no_noise_is_below_the_finest(repeats: bool) -> None:
    """A tenth of what may be resolved is raised to that, ten times as much stays, to one per cent in squares."""
    for noise, rms in ((0.1 * FINEST, np.hypot(0.1, 1.0) * FINEST), (10.0 * FINEST, 10.0 * FINEST)):
        data = _record(repeats=repeats, noise=noise)
        (record,) = data.records
        whitener = whitener_from(data, [record.left_by(simulate(played(one_axis().linear(), RATE_HZ), record.u))])
        assert 1.0 / whitener.taps[0, 0] == pytest.approx(rms * float(np.std(record.y)), rel=0.03)


def test_an_output_has_the_same_noise_in_a_record_without_the_others() -> None:
    rng = np.random.default_rng(1)
    y = np.cumsum(rng.standard_normal((500, 2)), axis=0)
    (both,) = Dataset(RATE_HZ, (Record("r", y, y, (Window("a", 0, 500),)),)).records
    alone = both.only(np.array([1]))
    left = both.left_by(np.zeros_like(y))
    assert np.array_equal(left[:, 1:], alone.left_by(np.zeros((500, 1))))
    assert np.std(left - y, axis=0) == pytest.approx(FINEST * np.std(y, axis=0), rel=0.1)
