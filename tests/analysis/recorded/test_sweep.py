import numpy as np
import pytest

from analysis.recorded.sweep import difference_of, sweep_of
from sim_backend.errors import DataError
from sim_backend.linear import ModalModel, discretise

CHANNELS = [("torque_x", "N m", "input", "theta_x"), ("theta_x", "rad", "output", "theta_x")]
PLANT = ModalModel(
    np.array([2 * np.pi * 29.56]),
    np.array([60.0]),
    np.ones((1, 1)),
    np.zeros((1, 1)),
    np.full((1, 1), 3092.0),
    np.zeros((1, 1)),
    np.zeros((1, 1)),
    np.zeros(1),
)


def parts(frequencies_hz, noise, rng):
    """Steady sines of the plant behind its hold, each measured from its 1000th sample on."""
    plant = discretise(PLANT, 1e4)
    out = []
    for f in frequencies_hz:
        t = np.arange(3000) / 1e4
        g = plant.frequency_response(np.array([f]))[0, 0, 0]
        torque = 2e-3 * np.cos(2 * np.pi * f * t)
        angle = 2e-3 * np.abs(g) * np.cos(2 * np.pi * f * t + np.angle(g)) + noise * rng.normal(size=t.size)
        angle[:1000] += 1.0  # whatever happens while it settles must not count
        out.append(
            (
                f"{f:g} Hz",
                {"axis": "theta_x", "frequency_hz": f, "measure_from": 1000, "amplitude": 2e-3},
                {"torque_x": torque, "theta_x": angle},
            )
        )
    return out


def test_the_response_of_a_known_plant_in_rising_order(write_log):
    frequencies = [100.0, 5.0, 30.0]
    found = sweep_of(write_log("sinesweep", CHANNELS, parts(frequencies, 0.0, np.random.default_rng(1))))
    np.testing.assert_array_equal(found.frequency_hz, [5.0, 30.0, 100.0])
    exact = PLANT.frequency_response(found.frequency_hz, 1e4)[:, 0, 0]
    np.testing.assert_allclose(found.response, exact, rtol=1e-9)
    np.testing.assert_allclose(found.amplitude, 2e-3, rtol=1e-9)
    np.testing.assert_allclose(found.magnitude_db, 20 * np.log10(np.abs(exact)), atol=1e-7)


def test_its_uncertainty_is_that_of_the_noise(write_log):
    rng = np.random.default_rng(2)
    frequencies = np.full(60, 50.0) + np.arange(60)  # sixty independent points
    found = sweep_of(write_log("sinesweep", CHANNELS, parts(frequencies, 1e-6, rng)))
    exact = PLANT.frequency_response(found.frequency_hz, 1e4)[:, 0, 0]
    pull = (np.abs(found.response) / np.abs(exact) - 1.0) / found.relative_std
    # 60 pulls of deviation one, with deviations estimated from 8 lines each: 1.0 to 1.2, ± 3/sqrt(120)
    assert 0.75 < np.sqrt(np.mean(pull**2)) < 1.45


def test_two_sweeps_are_compared_frequency_by_frequency(write_log):
    rng = np.random.default_rng(3)
    one = sweep_of(write_log("sinesweep", CHANNELS, parts([5.0, 30.0], 0.0, rng)))
    other = sweep_of(write_log("sinesweep", CHANNELS, parts([5.0, 40.0], 0.0, rng), name="other.h5"))
    assert abs(difference_of(one, one).largest_db) == 0.0
    with pytest.raises(DataError, match="same bands"):
        difference_of(one, other)


def test_other_logs_are_refused(write_log):
    run = write_log("chop", CHANNELS, [("chop", {}, {"torque_x": np.zeros(9), "theta_x": np.zeros(9)})])
    with pytest.raises(DataError, match="no stepped sine"):
        sweep_of(run)
    settings = {"axis": "z", "frequency_hz": 5.0, "measure_from": 0}
    lacking = write_log(
        "sinesweep", CHANNELS, [("5", settings, {"torque_x": np.zeros(9), "theta_x": np.zeros(9)})], name="z.h5"
    )
    with pytest.raises(DataError, match="axis 'z'"):
        sweep_of(lacking)
