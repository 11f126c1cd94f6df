from typing import Any

import numpy as np
import pytest
from scipy import signal
from scipy.stats import binom

import analysis.identification.timefit
from analysis.identification.modal_parameters import Structure, layout_of, pack
from analysis.identification.time_residual import TimeTarget, time_normal_equations, whitened_cost
from analysis.identification.timefit import fit_records
from analysis.identification.whitening import whitening_filters
from sim_backend.errors import ConfigError, DataError
from sim_backend.linear import ModalModel

RATE = 1000.0


def _simulate(model, u, x0, feedback=0.0, noise=None):
    a, b, c, d = model.state_space()
    ad, bd, cd, dd = signal.cont2discrete((a, b, c, d), 1.0 / RATE)[:4]
    x, y, drive = x0.ravel().copy(), np.zeros((u.shape[0], c.shape[0])), u.copy()
    for k in range(u.shape[0]):
        y[k] = cd @ x + (0.0 if noise is None else noise[k])
        drive[k] = u[k] - feedback * y[k]
        y[k] += dd @ drive[k]
        x = ad @ x + bd @ drive[k]
    return y, drive


def _one_mode(frequency_hz=40.0, sigma=12.0, gain=1e4):
    zero = np.zeros((1, 1))
    omega = np.array([2.0 * np.pi * frequency_hz])
    return ModalModel(omega, np.array([sigma]), np.ones((1, 1)), zero, np.array([[gain]]), zero, zero, np.zeros(1))


def test_gradient_matches_finite_differences(rng, plant):
    model = plant(rng, 2, 2, 2, False, band_hz=(30.0, 200.0)).with_(delay_s=np.array([1.7e-3, 3.2e-3]))
    layout = layout_of(model, Structure(delay=True))
    # longer than one chunk in the first record, so that the whitening filter's memory crosses the seam
    lengths = (4500, 700)
    inputs = tuple(rng.normal(size=(n, 2)) for n in lengths)
    outputs = tuple(rng.normal(size=(n, 2)) for n in lengths)
    vector = np.concatenate([pack(model), 0.1 * rng.normal(size=2 * (4 + 2))])
    target = TimeTarget(inputs, outputs, RATE, np.array([[1.0, -0.5, 0.2], [1.5, -0.3, 0.1]]))
    normal = time_normal_equations(target, vector, layout)
    assert normal.cost == pytest.approx(whitened_cost(target, vector, layout), rel=1e-10)
    for i in range(vector.size):
        step = np.zeros(vector.size)
        step[i] = 1e-6 * max(abs(vector[i]), 1e-6)
        up, down = (whitened_cost(target, vector + s * step, layout) for s in (1.0, -1.0))
        rounding = 1e-15 * normal.cost / step[i]
        # a central difference is off by the squared ratio of the step to the width of a resonance, times a few
        assert normal.gradient[i] == pytest.approx((up - down) / (4.0 * step[i]), rel=5e-5, abs=100.0 * rounding)


def test_starts_that_were_compared_are_not_followed_again(rng, monkeypatch):
    u = rng.normal(size=(600, 1))
    y, _ = _simulate(_one_mode(), u, np.zeros((1, 2)))
    y = y + 0.05 * y.std() * rng.normal(size=y.shape)
    taken: list[int] = []
    module: Any = analysis.identification.timefit
    minimise = module.minimise

    def counted(*given):
        found = minimise(*given)
        taken.append(found.iterations)
        return found

    monkeypatch.setattr(module, "minimise", counted)
    compared: dict[Any, Any] = {}
    fits, steps = [], []
    for _ in range(2):
        taken.clear()
        fits.append(fit_records([u], [y], RATE, 2, compared=compared))
        steps.append(list(taken))
    assert fits[0].criterion == fits[1].criterion
    assert steps[0][len(steps[0]) - len(steps[1]) :] == steps[1]  # the last steps, with coloured noise
    assert sum(steps[1]) < 0.5 * sum(steps[0])


def test_short_records_with_transients_are_calibrated(rng):
    model, trials, inside = _one_mode(), 25, 0
    for _ in range(trials):
        u = rng.normal(size=(300, 1))
        y, _ = _simulate(model, u, rng.normal(size=(1, 2)) * [1e-4, 0.03])
        y = y + 0.05 * y.std() * rng.normal(size=y.shape) + 0.3
        fit = fit_records([u], [y], RATE, 1, structure=Structure("mechanical", False), noise_order=0)
        inside += abs(fit.model.omega_rad_s[0] - model.omega_rad_s[0]) < 2.0 * fit.omega_std_rad_s[0]
        inside += abs(fit.model.sigma_1_s[0] - model.sigma_1_s[0]) < 2.0 * fit.sigma_std_1_s[0]
    low, high = binom.ppf([1e-4, 1.0 - 1e-4], 2 * trials, 0.9545)
    assert low <= inside <= high


@pytest.mark.parametrize("loop", [0.0, 0.4])
def test_coloured_noise_in_open_and_closed_loop_neither_biases_nor_flatters(rng, loop):
    model, trials, errors = _one_mode(), 15, []
    for _ in range(trials):
        r = rng.normal(size=(1000, 1))
        noise = signal.lfilter([1.0], [1.0, -0.8], rng.normal(size=(1000, 1)), axis=0)
        size = _simulate(model, r, np.zeros((1, 2)))[0].std()
        y, u = _simulate(model, r, np.zeros((1, 2)), loop / size, 0.1 * size * noise)
        fit = fit_records([u], [y], RATE, 1, structure=Structure("mechanical", False))
        assert fit.whitening.shape[1] > 1
        gain_std = np.sqrt(fit.covariance[fit.layout.index("c")[0, 0], fit.layout.index("c")[0, 0]])
        errors.append([
            (fit.model.omega_rad_s[0] - model.omega_rad_s[0]) / fit.omega_std_rad_s[0],
            (fit.model.sigma_1_s[0] - model.sigma_1_s[0]) / fit.sigma_std_1_s[0],
            (fit.model.c[0, 0] - 1e4) / gain_std,
        ])  # fmt: skip
    z = np.array(errors)
    # means of 15 unit errors; an unmodelled loop or colour moves them by several
    assert np.max(np.abs(z.mean(axis=0))) < 4.5 / np.sqrt(trials)
    low, high = binom.ppf([1e-4, 1.0 - 1e-4], 3 * trials, 0.9545)
    assert low <= np.sum(np.abs(z) < 2.0) <= high


def test_two_inputs_two_outputs_two_records(rng, plant):
    model = plant(rng, 2, 2, 2, False, band_hz=(30.0, 200.0))
    records = []
    for n in (800, 500):
        u = rng.normal(size=(n, 2))
        y, _ = _simulate(model, u, rng.normal(size=(2, 2)) * [1e-5, 1e-3])
        records.append((u, y))
    std = 0.02 * records[0][1].std()
    noisy = [y + std * rng.normal(size=y.shape) for _, y in records]
    fit = fit_records([u for u, _ in records], noisy, RATE, 2)
    left = np.concatenate([m - y for m, y in zip(fit.outputs, noisy, strict=True)])
    # 2600 values less 37 parameters: the rms is known to 1 / sqrt(2 * 2563) = 1.4 %
    assert np.sqrt(np.sum(left**2) / (left.size - 37)) == pytest.approx(std, rel=0.07)
    f = np.linspace(5.0, 450.0, 200)
    exact = model.frequency_response(f, RATE)
    error = np.abs(fit.model.frequency_response(f, RATE) - exact)
    assert np.sqrt(np.mean(error**2) / np.mean(np.abs(exact) ** 2)) < 0.01


def test_rigid_body_beside_a_flexible_mode(rng):
    model = ModalModel(
        np.array([0.0, 2.0 * np.pi * 60.0]), np.array([0.0, 8.0]), np.ones((2, 1)), np.zeros((2, 1)),
        np.array([[1.0, 20.0]]), np.zeros((1, 2)), np.zeros((1, 1)), np.zeros(1),
    )  # fmt: skip
    u = rng.normal(size=(1000, 1))
    y, _ = _simulate(model, u, rng.normal(size=(2, 2)) * [0.003, 0.1])
    fit = fit_records(
        [u], [y + 1e-4 * rng.normal(size=y.shape)], RATE, 2, structure=Structure("mechanical", False), rigid_bodies=None
    )
    order = np.argsort(fit.model.omega_rad_s)
    assert fit.model.omega_rad_s[order[0]] == 0.0
    flexible = order[1]
    assert fit.model.omega_rad_s[flexible] == pytest.approx(2 * np.pi * 60.0, abs=5 * fit.omega_std_rad_s[flexible])
    std = np.sqrt(np.diag(fit.covariance))[fit.layout.index("c")[0]]
    assert fit.model.c[0, order[0]] == pytest.approx(1.0, abs=5.0 * std[order[0]])


def test_whitening_finds_an_autoregression(rng):
    noise = signal.lfilter([1.0], [1.0, -1.2, 0.6], 0.3 * rng.normal(size=(20000, 1)), axis=0)
    found = whitening_filters([noise], None)[0]
    # coefficients of an AR(2) are known to 1 / sqrt(n) = 0.007, the innovation to half of that
    assert np.allclose(found[:3] * 0.3, [1.0, -1.2, 0.6], atol=5.0 * 0.007)


def test_bad_records_are_refused(rng):
    u = rng.normal(size=(200, 1))
    with pytest.raises(ConfigError, match="1 input and 0 output"):
        fit_records([u], [], RATE, 1)
    with pytest.raises(DataError, match="channel 0 is constant"):
        fit_records([u], [np.ones((200, 1))], RATE, 1)
    with pytest.raises(DataError, match="not finite"):
        fit_records([u], [u * np.inf], RATE, 1)
    with pytest.raises(DataError, match="give no start"):
        fit_records([u[:20]], [u[:20]], RATE, 8)
