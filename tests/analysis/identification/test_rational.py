import numpy as np
import pytest
from scipy.stats import binom, chi2

from analysis.identification.magnitude_fit import fit_magnitude
from analysis.identification.modal_parameters import Structure, layout_of, pack, unpack
from analysis.identification.rational import fit_rational
from analysis.identification.response_fit import make_target, model_response, normal_equations, residual_cost
from sim_backend.errors import ConfigError, DataError
from sim_backend.linear import ModalModel


def _noisy(rng, response, std):
    return response + std * (rng.normal(size=response.shape) + 1j * rng.normal(size=response.shape)) / np.sqrt(2.0)


def _interval(trials, probability=0.9545, risk=1e-4):
    """Counts within which a calibrated two-sigma coverage falls but for `risk`."""
    return binom.ppf(risk / 2, trials, probability), binom.ppf(1 - risk / 2, trials, probability)


@pytest.mark.parametrize("hold", [None, 10000.0])
@pytest.mark.parametrize("magnitude_only", [False, True])
def test_gradient_matches_finite_differences(rng, plant, hold, magnitude_only):
    model = plant(rng, 3, 2, 2, False).with_(delay_s=np.array([1.3e-4, 2.6e-4]))
    f = np.linspace(7.0, 3000.0, 60)
    target = make_target(f, 1.1 * model.frequency_response(f, hold), None, hold, magnitude_only)
    layout = layout_of(model, Structure(delay=True))
    vector = pack(model)
    normal = normal_equations(target, model, layout)
    assert normal.cost == pytest.approx(residual_cost(target, model), rel=1e-12)
    for i in range(layout.size):
        step = np.zeros(layout.size)
        step[i] = 1e-6 * max(abs(vector[i]), 1e-6)
        up, down = (residual_cost(target, unpack(vector + s * step, layout)) for s in (1.0, -1.0))
        # rounding of the cost over the step; and the second-order error of a central difference, the squared ratio of
        # the step (8e-6 in a logarithm) to the width of a resonance (5e-3), times a few
        rounding = 1e-15 * normal.cost / step[i]
        assert normal.gradient[i] == pytest.approx((up - down) / (4.0 * step[i]), rel=3e-5, abs=100.0 * rounding)


@pytest.mark.parametrize("hold", [None, 10000.0])
@pytest.mark.parametrize("magnitude_only", [False, True])
def test_products_of_derivatives_match_finite_differences(rng, plant, hold, magnitude_only):
    model = plant(rng, 2, 2, 3, False).with_(delay_s=np.array([1.3e-4, 2.6e-4, 3.9e-4]))
    # lines that are no multiple of any power of two, with weights of their own
    f = np.linspace(7.0, 3000.0, 149)
    exact = model.frequency_response(f, hold)
    variance = rng.uniform(0.5, 2.0, exact.shape) * np.mean(np.abs(exact) ** 2)
    target = make_target(f, 1.1 * exact, variance, hold, magnitude_only)
    layout = layout_of(model, Structure(delay=True))

    def seen(vector):
        response = model_response(unpack(vector, layout), target)  # parts of a sample are interpolated there
        values = np.abs(response) if magnitude_only else response
        return (np.sqrt(2.0 / variance) * values).ravel()

    vector, slopes = pack(model), []
    for i in range(layout.size):
        step = np.zeros(layout.size)
        step[i] = 1e-6 * max(abs(vector[i]), 1e-4)
        slopes.append((seen(vector + step) - seen(vector - step)) / (2.0 * step[i]))
    # a magnitude does not depend on a delay
    told = slice(0, layout.span("delay_s").start if magnitude_only else layout.size)
    want = (np.conj(slopes) @ np.transpose(slopes)).real[told, told]
    size = np.sqrt(np.diag(want))
    # of each product of two slopes: second order in a step (8e-6 in a logarithm) over a resonance's width (5e-3), and
    # the rounding of a response, 1e-16 of its largest value, over the step
    found = normal_equations(target, model, layout).hessian[told, told]
    np.testing.assert_allclose(found / np.outer(size, size), want / np.outer(size, size), rtol=0, atol=3e-5)


@pytest.mark.parametrize(("n_y", "n_u", "blocks", "mechanical", "hold"), [
    (1, 1, 3, True, 10000.0), (1, 1, 4, False, None), (2, 3, 5, True, 10000.0), (3, 3, 6, False, 6400.0),
])  # fmt: skip
def test_known_plants_are_recovered_down_to_the_noise(rng, plant, n_y, n_u, blocks, mechanical, hold):
    model = plant(rng, blocks, n_y, n_u, mechanical)
    f = np.arange(10.0, 3000.0, 3.0)
    exact = model.frequency_response(f, hold)
    std = 1e-3 * np.sqrt(np.mean(np.abs(exact) ** 2))
    structure = Structure("mechanical", False) if mechanical else Structure()
    fit = fit_rational(
        f,
        _noisy(rng, exact, std),
        blocks,
        variance=np.full(exact.shape, std**2),
        hold_rate_hz=hold,
        structure=structure,
    )
    # chi2 with the true number of parameters: outside this range once in 10,000 fits
    assert chi2.ppf(5e-5, fit.dof) < fit.chi2 < chi2.ppf(1 - 5e-5, fit.dof)
    free = (2 + (n_u + n_y) * (1 if mechanical else 2)) * blocks - blocks * (1 if mechanical else 2)
    assert 2 * exact.size - fit.dof == free + (0 if mechanical else n_u * n_y)
    order = np.argsort(model.omega_rad_s)
    z = (np.sort(fit.model.omega_rad_s) - model.omega_rad_s[order]) / fit.omega_std_rad_s[
        np.argsort(fit.model.omega_rad_s)
    ]
    assert np.max(np.abs(z)) < 5.0


def test_badly_scaled_units_do_not_matter(rng, plant):
    model = plant(rng, 3, 1, 1, True)
    f = np.arange(10.0, 3000.0, 5.0)
    data = model.frequency_response(f, 10000.0)
    small = fit_rational(f, 1e-9 * data, 3, hold_rate_hz=10000.0, structure=Structure("mechanical", False))
    assert np.allclose(np.sort(small.model.omega_rad_s), model.omega_rad_s, rtol=1e-7)
    assert np.allclose(np.sort(small.model.c[0]), np.sort(1e-9 * (model.c[0] * model.b[:, 0])), rtol=1e-6)


def test_standard_deviations_are_calibrated_and_the_spread_is_theirs(rng, plant):
    model = plant(rng, 2, 2, 2, False, band_hz=(60.0, 400.0))
    f, hold, trials = np.arange(5.0, 800.0, 4.0), 2000.0, 150
    exact = model.frequency_response(f, hold)
    std = 0.01 * np.sqrt(np.mean(np.abs(exact) ** 2))
    inside, total, spread, claimed = 0, 0, [], []
    for _ in range(trials):
        fit = fit_rational(f, _noisy(rng, exact, std), 2, variance=np.full(exact.shape, std**2), hold_rate_hz=hold)
        order = np.argsort(fit.model.omega_rad_s)
        error = np.log(np.concatenate([fit.model.omega_rad_s, fit.model.sigma_1_s])[np.r_[order, order + 2]])
        error = error - np.log(np.concatenate([model.omega_rad_s, model.sigma_1_s]))
        deviation = np.sqrt(np.diag(fit.covariance))[:4][np.r_[order, order + 2]]
        inside, total = inside + int(np.sum(np.abs(error) < 2.0 * deviation)), total + 4
        spread.append(error)
        claimed.append(deviation)
    low, high = _interval(total)
    assert low <= inside <= high
    # a variance from 150 samples has a relative standard deviation of sqrt(2 / 150) = 0.115; allow four of them
    ratio = np.var(spread, axis=0) / np.mean(np.square(claimed), axis=0)
    assert np.all(np.abs(ratio - 1.0) < 0.46)


def test_magnitude_alone_finds_modes_of_either_sign():
    omega = 2.0 * np.pi * np.array([29.56, 123.25, 489.5, 1440.0])
    gain = np.array([[3000.0, 30.0, -80.0, -900.0]])
    model = ModalModel(
        omega, np.array([6.0, 5.0, 15.0, 34.0]), np.ones((4, 1)), np.zeros((4, 1)), gain, np.zeros((1, 4)),
        np.zeros((1, 1)), np.zeros(1),
    )  # fmt: skip
    f = np.geomspace(5.0, 2000.0, 400)
    exact = np.abs(model.frequency_response(f, 10000.0)[:, 0, 0])
    rng, inside, trials = np.random.default_rng(3), 0, 20
    for _ in range(trials):
        fit = fit_magnitude(
            f, exact * (1.0 + 0.01 * rng.normal(size=f.size)), 4, std=0.01 * exact, hold_rate_hz=10000.0
        )
        std = np.sqrt(np.diag(fit.covariance))[fit.layout.index("c")[0]]
        assert np.array_equal(np.sign(fit.model.c[0]), np.sign(gain[0]))
        inside += int(np.sum(np.abs(fit.model.c[0] - gain[0]) < 2.0 * std))
        inside += int(np.sum(np.abs(fit.model.omega_rad_s - omega) < 2.0 * fit.omega_std_rad_s))
    low, high = _interval(8 * trials)
    assert low <= inside <= high


def test_the_number_of_blocks_is_chosen(rng, plant):
    model = plant(rng, 3, 2, 2, True)
    f = np.arange(10.0, 3000.0, 6.0)
    exact = model.frequency_response(f)
    std = 1e-3 * np.sqrt(np.mean(np.abs(exact) ** 2))
    fit = fit_rational(f, _noisy(rng, exact, std), (1, 2, 3, 4), variance=np.full(exact.shape, std**2))
    assert fit.model.n_blocks == 3
    assert [count for count, _ in fit.orders] == [1, 2, 3, 4]


@pytest.mark.parametrize("rigid", [1, None])
def test_rigid_body_is_found(rng, rigid):
    model = ModalModel(
        np.array([0.0, 2.0 * np.pi * 80.0]), np.array([0.0, 5.0]), np.ones((2, 1)), np.zeros((2, 1)),
        np.array([[1.0, 0.7]]), np.zeros((1, 2)), np.zeros((1, 1)), np.zeros(1),
    )  # fmt: skip
    f = np.geomspace(1.0, 400.0, 300)
    exact = model.frequency_response(f, 2000.0)
    variance = (0.01 * np.abs(exact)) ** 2
    noisy = exact + np.sqrt(variance / 2) * (rng.normal(size=exact.shape) + 1j * rng.normal(size=exact.shape))
    structure = Structure("mechanical", False)
    fit = fit_rational(f, noisy, 2, variance=variance, hold_rate_hz=2000.0, structure=structure, rigid_bodies=rigid)
    assert np.min(fit.model.omega_rad_s) == 0.0
    assert np.max(fit.model.omega_rad_s) == pytest.approx(2.0 * np.pi * 80.0, abs=5.0 * np.max(fit.omega_std_rad_s))


def test_delay_is_found(rng, plant):
    model = plant(rng, 2, 1, 1, True).with_(delay_s=np.array([2.37e-4]))
    f = np.arange(10.0, 3000.0, 5.0)
    exact = model.frequency_response(f)
    std = 1e-3 * np.sqrt(np.mean(np.abs(exact) ** 2))
    structure = Structure("mechanical", False, True)
    fit = fit_rational(f, _noisy(rng, exact, std), 2, variance=np.full(exact.shape, std**2), structure=structure)
    deviation = np.sqrt(fit.covariance[fit.layout.index("delay_s")[0], fit.layout.index("delay_s")[0]])
    assert fit.model.delay_s[0] == pytest.approx(2.37e-4, abs=5.0 * deviation)
    assert deviation < 1e-6


def test_bad_data_is_refused():
    f, g = np.arange(1.0, 50.0), np.ones((49, 1, 1), dtype=np.complex128)
    with pytest.raises(ConfigError, match="25 modes .* choose 1 to"):
        fit_rational(f, g, 25)
    with pytest.raises(ConfigError, match="above half the hold rate"):
        fit_rational(f, g, 1, hold_rate_hz=60.0)
    with pytest.raises(DataError, match="not finite"):
        fit_rational(f, g * np.nan, 1)
    with pytest.raises(ConfigError, match="form 'modal' is unknown"):
        Structure("modal")
