import numpy as np
import pytest

from analysis.measurements.power import coil_power
from sim_backend.errors import DataError


def test_a_sine_dissipates_half_its_peak_square():
    period = 200
    current = np.zeros((5 * period + 37, 3))
    current[:, 0] = 2.0 * np.sin(2 * np.pi * np.arange(current.shape[0]) / period)
    current[:, 1] = -0.5
    found = coil_power(current, 5.7, 7.9, period)
    resistance_ohm = (5.7 / 7.9) ** 2
    np.testing.assert_allclose(found.actuator_w, resistance_ohm * np.array([2.0, 0.25, 0.0]), rtol=1e-12)
    assert found.total_w == pytest.approx(resistance_ohm * 2.25, rel=1e-12)
    assert found.peak_a == pytest.approx(2.0, rel=1e-12)


@pytest.mark.parametrize(("constant", "period"), [(0.0, 10), (5.7, 500), (5.7, 0)])
def test_bad_input_is_refused(constant, period):
    with pytest.raises(DataError):
        coil_power(np.ones((100, 3)), constant, 7.9, period)
