import numpy as np
import pytest
from scipy.stats import linregress

from analysis.measurements.theodolite import calibrate
from sim_backend.errors import DataError


def measured(rng, gain=(1.005, 1.004), noise_rad=5e-6):
    sensor = np.stack([np.linspace(-8e-3, 8e-3, 17), np.linspace(8e-3, -8e-3, 17)], axis=1)
    return sensor, np.array(gain) * sensor + 1e-5 + noise_rad * rng.normal(size=sensor.shape)


def test_the_line_equals_an_independent_regression():
    sensor, reading = measured(np.random.default_rng(4))
    found = calibrate(sensor, reading)
    for axis in range(2):
        line = linregress(sensor[:, axis], reading[:, axis])
        assert found.gain_correction[axis] == pytest.approx(line.slope - 1.0, rel=1e-9)
        assert found.gain_correction_std[axis] == pytest.approx(line.stderr, rel=1e-9)
        assert found.offset_rad[axis] == pytest.approx(line.intercept, rel=1e-9)
        assert found.offset_std_rad[axis] == pytest.approx(line.intercept_stderr, rel=1e-9)
        assert found.correlation[axis] == pytest.approx(line.rvalue**2, rel=1e-12)


def test_the_stated_uncertainty_holds():
    rng = np.random.default_rng(5)
    pulls = np.array([(c.gain_correction - (0.005, 0.004)) / c.gain_correction_std for c in _many(rng, 300)])
    # Student's t with 15 degrees of freedom has deviation 1.07; 600 pulls know theirs to 3 %, four times that is 12 %
    assert pulls.std() == pytest.approx(1.07, rel=0.12)


def _many(rng, n):
    return [calibrate(*measured(rng)) for _ in range(n)]


def test_an_axis_that_never_moves_is_refused():
    sensor = np.stack([np.linspace(-1e-3, 1e-3, 5), np.full(5, 2e-3)], axis=1)
    with pytest.raises(DataError, match="axis 2 stays at 0.002 rad"):
        calibrate(sensor, sensor)


def test_as_many_readings_as_positions():
    with pytest.raises(DataError, match="one reading per position"):
        calibrate(np.zeros((5, 2)), np.zeros((4, 2)))
