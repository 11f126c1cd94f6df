import numpy as np
import pytest
from scipy import signal

from analysis.linear.simulate import delayed, periodic_response, simulate_linear
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel, discretise, played


def test_matches_scipy_state_space_over_several_chunks(rng, plant):
    model = plant(rng, 5, 3, 2, False)
    u = rng.normal(size=(10000, 2))
    x0 = rng.normal(size=(5, 2))
    a, b, c, d = model.state_space()
    _, want, _ = signal.dlsim((*signal.cont2discrete((a, b, c, d), 1e-4)[:4], 1e-4), u, x0=x0.ravel())
    got = simulate_linear(discretise(model, 1e4), u, x0)
    assert np.allclose(got, want, atol=1e-9 * np.std(want))


@pytest.mark.parametrize("n", [0, 1, 63, 64, 65, 4353, 8704, 8705])
def test_every_length_and_every_path_from_input_to_output(rng, plant, n):
    # some blocks are driven by the second input alone, or seen in the last output alone
    model = plant(rng, 3, 3, 2, False)
    b, c = model.b * [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]], model.c * [[1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 1.0]]
    model = model.with_(b=b, b_direct=np.zeros_like(b), c=c, c_rate=np.zeros_like(c))
    u, discrete = rng.normal(size=(n, 2)), discretise(model, 1e4)
    a, b, c, d = model.state_space()
    want = np.zeros((n, 3))
    if n:
        want = signal.dlsim((*signal.cont2discrete((a, b, c, d), 1e-4)[:4], 1e-4), u)[1]
    # a rounding of 1e-16 lives on for the memory of the slowest mode, some thousands of samples
    assert np.allclose(simulate_linear(discrete, u), want, rtol=0, atol=1e-9 * np.max(np.abs(want), initial=0.0))


def test_what_no_output_sees_may_run_away(rng, plant):
    model = plant(rng, 2, 1, 1, True)
    lost = model.with_(sigma_1_s=model.sigma_1_s * [1.0, -1e3], c=model.c * [1.0, 0.0])
    u = rng.normal(size=(9000, 1))
    alone = simulate_linear(discretise(model.only(np.array([True, False])), 1e4), u)
    np.testing.assert_array_equal(simulate_linear(discretise(lost, 1e4), u), alone)


def test_steady_state_of_a_periodic_input_with_fractional_delay(rng, plant):
    model = plant(rng, 3, 2, 2, True, band_hz=(100.0, 2000.0)).with_(delay_s=np.array([0.0, 2.34e-4]))
    model = model.with_(sigma_1_s=np.full(3, 40.0))
    discrete = discretise(model, 1e4)
    u = rng.normal(size=(2000, 2))
    long = simulate_linear(discrete, np.tile(u, (6, 1)))[-2000:]
    steady = periodic_response(discrete.frequency_response(np.arange(1001.0) * 5.0), u)
    # five periods of 0.2 s leave e^-40 of the transient
    assert np.allclose(long, steady, atol=1e-11 * np.std(steady))


@pytest.mark.parametrize("samples", [0.0, 0.3, 1.0, 1.25, 3.75])
def test_delayed_input_is_the_cubic_through_its_samples(samples):
    t = np.arange(12.0)
    u = np.stack([t**3 - 4.0 * t**2 + 1.0, 5.0 - t], axis=1)
    late = t - samples
    want = np.stack([late**3 - 4.0 * late**2 + 1.0, 5.0 - late], axis=1)
    # beyond the reach of the four samples a cubic is its own interpolation
    np.testing.assert_allclose(delayed(u, np.full(2, samples))[7:], want[7:], rtol=1e-12, atol=1e-11)
    assert np.array_equal(delayed(u[:, :1], np.array([13.5])), np.zeros((12, 1)))


def test_wrong_shapes_are_refused(rng, plant):
    discrete = discretise(plant(rng, 2, 1, 1, True), 1e4)
    with pytest.raises(ConfigError, match=r"needs \(n, 1\)"):
        simulate_linear(discrete, np.ones(5))
    with pytest.raises(ConfigError, match=r"needs \(2, 2\)"):
        simulate_linear(discrete, np.ones((5, 1)), np.zeros(4))
    with pytest.raises(ConfigError, match="needs"):
        periodic_response(np.ones((5, 1, 1), dtype=np.complex128), np.ones((20, 1)))


@pytest.mark.parametrize("late_samples", [0.0, 0.3, 1.0, 2.7])
def test_a_delay_of_parts_of_a_sample_is_exact_in_time_and_as_a_response(late_samples):
    """Against steps a tenth as long, of which the delay is a whole number; with a direct path, near half the rate."""
    rate_hz, finer, period = 100.0, 10, 300
    rng = np.random.default_rng(4)
    zero = np.zeros((1, 1))
    mode = ModalModel(np.array([250.0]), np.array([9.0]), np.ones((1, 1)), zero, np.array([[3e4]]), zero, zero, zero[0])
    direct = mode.with_(d=np.array([[0.4]]), c_rate=np.array([[20.0]]))
    late = direct.with_(delay_s=np.array([late_samples / rate_hz]))
    u = np.tile(rng.standard_normal((period, 1)), (10, 1))
    fine = np.repeat(u, finer, axis=0)
    shift = round(late_samples * finer)
    fine = np.concatenate([np.zeros((shift, 1)), fine[: fine.shape[0] - shift]])
    want = simulate_linear(discretise(direct, finer * rate_hz), fine)[::finer]
    found = simulate_linear(played(late, rate_hz), u)
    np.testing.assert_allclose(found, want, rtol=0, atol=1e-11 * np.abs(want).max())
    response = late.frequency_response(np.arange(period // 2 + 1) * rate_hz / period, rate_hz)
    steady = periodic_response(response, u[:period])
    # ten periods: what the start rings for has died out to e^-81
    np.testing.assert_allclose(steady, found[-period:], rtol=0, atol=1e-11 * np.abs(want).max())
