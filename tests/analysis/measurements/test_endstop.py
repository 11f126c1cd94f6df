import numpy as np
import pytest

from analysis.measurements.endstop import NOISE_LIMIT_M, endstop_noise
from sim_backend.errors import DataError


def test_noise_and_drift_come_back_from_known_records():
    rng = np.random.default_rng(3)
    sigma = np.array([[2e-9, 5e-9, 9e-9], [4e-9, 1e-9, 12e-9]])
    drift = np.array([[1e-6, 0.0, -2e-6], [0.0, 3e-6, 0.0]])
    n, rate_hz = 20_000, 10_000.0
    t = np.arange(n) / rate_hz
    readings = 1e-3 + drift[:, None, :] * t[:, None] + sigma[:, None, :] * rng.normal(size=(2, n, 3))
    found = endstop_noise(readings, rate_hz)
    # every value within four of its own standard deviations: 12 values, chance of a miss below 1e-3
    assert np.all(np.abs(found.three_sigma_m - 3.0 * sigma) < 4.0 * found.three_sigma_std_m)
    assert np.all(found.three_sigma_std_m < 0.01 * found.three_sigma_m)  # 1/sqrt(2 n) = 0.5 %
    slope_std = sigma * np.sqrt(12.0 / n**3) * rate_hz
    assert np.all(np.abs(found.drift_m_s - drift) < 4.0 * slope_std)
    assert found.worst_m == found.three_sigma_m.max() > NOISE_LIMIT_M


@pytest.mark.parametrize(("shape", "rate_hz"), [((2, 2, 3), 1e4), ((2, 50), 1e4), ((2, 50, 3), 0.0)])
def test_bad_records_are_refused(shape, rate_hz):
    with pytest.raises(DataError, match="end stops"):
        endstop_noise(np.zeros(shape), rate_hz)
