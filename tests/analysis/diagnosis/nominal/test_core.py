"""The parts of the search, each against an independent computation."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import dlsim, lfilter

from analysis.diagnosis.candidates.signature import Candidate, Motion, Scales, enumerate_candidates, signature
from analysis.diagnosis.fitting.descent import Descent, inverse_of
from analysis.diagnosis.fitting.starts import stack_white, start_of
from analysis.diagnosis.noise.autoregression import fit_ar
from analysis.diagnosis.noise.estimate import whitener_from
from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.nominal.responses import free_responses, simulate
from analysis.diagnosis.nominal.tuning import knobs_of, sensitivities, turned
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from analysis.diagnosis.search.gram import Gram
from analysis.diagnosis.search.shortlist import thresholds
from sim_backend.assembly import places_of, transducers_of
from sim_backend.effects import EFFECTS, effect_class
from sim_backend.effects.view import RecordView
from sim_backend.linear import ModalModel, discretise
from sim_backend.model import Mode, Model, Port
from sim_backend.replay import replay

RATE_HZ = 2000.0
INERTIA = 3.23e-4


def linear_model() -> ModalModel:
    return ModalModel(
        omega_rad_s=2 * np.pi * np.array([30.0, 250.0]),
        sigma_1_s=np.array([5.0, 20.0]),
        b=np.array([[1 / INERTIA], [-0.5 / INERTIA]]),
        b_direct=np.zeros((2, 1)),
        c=np.array([[1.0, 1.0]]),
        c_rate=np.array([[0.0, 1e-5]]),
        d=np.zeros((1, 1)),
        delay_s=np.zeros(1),
    )


def one_axis() -> Model:
    modes = [
        Mode(label="low", frequency_hz=30.0, decay_rate_1_s=5.0, input={"u": 1 / INERTIA}, output={"y": 1.0}),
        Mode(label="high", frequency_hz=250.0, decay_rate_1_s=20.0, input={"u": -0.5 / INERTIA}, output={"y": 1.0}),
    ]
    return Model(
        name="one axis",
        sample_rate_hz=RATE_HZ,
        inputs=[Port(name="u", unit="N m", dof="theta_x")],
        outputs=[Port(name="y", unit="rad", dof="theta_x")],
        modes=modes,
    )


def drive(n: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return 0.05 * lfilter([0.05], [1, -0.95], rng.standard_normal(n))[:, None]


def test_simulation_is_the_exact_hold_of_scipy() -> None:
    linear, u = linear_model(), drive(500)
    a, b, c, d = linear.state_space()
    from scipy.signal import cont2discrete

    system = cont2discrete((a, b, c, d), 1 / RATE_HZ)
    _, expected, _ = dlsim(system, u)
    np.testing.assert_allclose(simulate(discretise(linear, RATE_HZ), u), expected, rtol=0, atol=1e-12)


def test_start_states_are_recovered_and_projected_out() -> None:
    linear, u = linear_model(), drive(800)
    states = np.array([[1e-3, 0.05], [2e-4, -0.1]])
    moved, still = (
        replay(linear, [], places_of(one_axis()), transducers_of(one_axis()), u, RATE_HZ, start=x)
        for x in (states, np.zeros((2, 2)))
    )
    y = moved.position - still.position
    # the free response itself, against the matrix exponential
    from scipy.linalg import expm

    a, _, c, _ = linear.state_space()
    expected = [(c @ expm(a * k / RATE_HZ) @ states.reshape(-1))[0] for k in (0, 7, 300)]
    np.testing.assert_allclose(y[[0, 7, 300], 0], expected, rtol=1e-9)
    record = Record("r", u, y, (Window("all", 0, 800),))
    whitener = Whitener(np.array([[1e6]]), True)
    start = start_of(record, linear, whitener, RATE_HZ)
    white = stack_white(whitener, record, y[:, :, None])[:, 0]
    np.testing.assert_allclose(start.states(white), states, rtol=1e-6)
    assert np.linalg.norm(start.project(white)) < 1e-9 * np.linalg.norm(white)


def test_free_responses_span_every_start() -> None:
    free = free_responses(discretise(linear_model(), RATE_HZ), 50)
    assert free.shape == (50, 1, 4)
    assert np.linalg.matrix_rank(free[:, 0]) == 4


def test_sensitivities_are_the_difference_of_two_models() -> None:
    linear, u = linear_model(), drive(600)
    knobs = knobs_of(linear, 0.03)
    columns = sensitivities(linear, knobs, u, RATE_HZ, np.zeros((2, 2)))
    base = simulate(discretise(linear, RATE_HZ), u)
    for k, knob in enumerate(knobs):
        step = np.zeros(len(knobs))
        step[k] = 1e-4
        moved = simulate(discretise(turned(linear, knobs, step), RATE_HZ), u)
        difference = (moved - base)[:, 0] / 1e-4
        # a forward difference errs by half a step times the curvature, here below 2 % of the column for every knob
        assert np.linalg.norm(difference - columns[:, 0, k]) < 0.02 * np.linalg.norm(difference), knob


def test_noise_colour_is_found_and_removed() -> None:
    rng = np.random.default_rng(1)
    noise = 3e-6 * lfilter([1.0], [1.0, -1.2, 0.5], rng.standard_normal(40_000))
    taps = fit_ar([(noise, np.ones(noise.size, dtype=bool))])
    # standard deviation of an AR coefficient is about sqrt(1 - rho²)/sqrt(n) < 0.005
    np.testing.assert_allclose(taps[:3] / taps[0], [1.0, -1.2, 0.5], atol=0.02)
    white = lfilter(taps, 1.0, noise)[100:]
    assert white.std() == pytest.approx(1.0, abs=4 / np.sqrt(2 * white.size))
    lag = np.array([np.mean(white[k:] * white[:-k]) for k in range(1, 11)])
    assert np.max(np.abs(lag)) < 5 / np.sqrt(white.size)


def test_noise_is_what_does_not_repeat() -> None:
    rng = np.random.default_rng(2)
    period, repeats = 500, 6
    error_of_the_model = np.tile(1e-3 * rng.standard_normal(period), repeats)
    residual = (error_of_the_model + 2e-6 * rng.standard_normal(period * repeats))[:, None]
    u = np.zeros_like(residual)
    record = Record("r", u, residual, (Window("p", 0, period * repeats, False, period),))
    whitener = whitener_from(Dataset(RATE_HZ, (record,)), [residual])
    assert whitener.repeats
    # 2000 differences: the standard deviation is known to 1.6 %, the order selection may use up a little
    assert 1 / whitener.taps[0, 0] == pytest.approx(2e-6, rel=0.06)


def test_likelihood_ratios_are_those_of_least_squares() -> None:
    rng = np.random.default_rng(3)
    n = 300
    knobs, columns = rng.standard_normal((n, 2)), rng.standard_normal((n, 3))
    residual = columns @ [0.5, 0.0, -0.2] + knobs @ [3.0, 1.0] + rng.standard_normal(n)
    table = np.column_stack([residual, knobs, columns])
    gram = Gram(table.T @ table, 2, (np.array([3]), np.array([4, 5])), (False, False), n, True)
    reduced = gram.without(gram.knob_columns())

    def rss(*parts: np.ndarray) -> float:
        x = np.column_stack(parts)
        return float(np.linalg.lstsq(x, residual, rcond=None)[1][0])

    for i, own in enumerate((columns[:, :1], columns[:, 1:])):
        drop, sizes = gram.solve(reduced, [i])
        assert drop == pytest.approx(rss(knobs) - rss(knobs, own), rel=1e-6)
        expected = np.linalg.lstsq(np.column_stack([knobs, own]), residual, rcond=None)[0][2:]
        np.testing.assert_allclose(sizes, expected, rtol=1e-6)


def test_one_sided_sizes_stay_positive() -> None:
    rng = np.random.default_rng(4)
    column = rng.standard_normal(200)
    table = np.column_stack([-2.0 * column + rng.standard_normal(200), column])
    gram = Gram(table.T @ table, 0, (np.array([1]),), (True,), 200, True)
    drop, sizes = gram.solve(gram.without(gram.knob_columns()), [0])
    assert drop == pytest.approx(0.0, abs=1e-9)
    assert sizes[0] == pytest.approx(0.0, abs=1e-12)


def test_false_alarms_come_as_often_as_the_threshold_says() -> None:
    rng = np.random.default_rng(5)
    n, groups = 400, 12
    columns = rng.standard_normal((n, groups)) + rng.standard_normal((n, 1))  # strongly correlated candidates
    index = tuple(np.array([1 + i]) for i in range(groups))
    alarms = 0
    trials = 400
    table = np.column_stack([np.zeros(n), columns])
    gram = Gram(table.T @ table, 0, index, (False,) * groups, n, True)
    threshold = np.quantile(gram.null_ratios(gram.products, np.random.default_rng(6), 4000).max(axis=0), 0.95)
    for _ in range(trials):
        noise = np.column_stack([rng.standard_normal(n), columns])
        products = noise.T @ noise
        trial = Gram(products, 0, index, (False,) * groups, n, True)
        drops = np.array([trial.solve(products, [i])[0] for i in range(groups)])
        alarms += bool(np.max(trial.ratios(drops, products[0, 0])) > threshold)
    # 5 % of 400: binomial standard deviation 4.4, with the threshold's own error (4000 draws) 4.6; four of them
    assert 20 - 18 <= alarms <= 20 + 18


def test_each_cause_has_its_own_threshold_and_all_share_one_rate() -> None:
    # a cause of thirty shapes, one of four sizes and six plain ones; ratios of noise alone are chi-squared
    rng = np.random.default_rng(11)
    keys = [("shapes", "x")] * 30 + [("sizes", "x")] + [(f"plain {i}", "x") for i in range(6)]

    def drawn(draws: int) -> np.ndarray:
        freedoms = np.array([1] * 30 + [4] + [1] * 6)
        return rng.chisquare(freedoms[:, None], (37, draws))

    limits = thresholds(keys, drawn(4000), 0.02)
    alarms = np.mean(np.any(drawn(40_000) > limits[:, None], axis=0))
    # the limit is a quantile of 4000 draws: 80 of them beyond, known to 11 %, and the offsets to as much
    assert alarms == pytest.approx(0.02, rel=0.4)
    # of eight causes each is allowed a part in four hundred: chi-squared of one degree of freedom beyond 9.14
    assert limits[-1] == pytest.approx(9.14, abs=0.7)
    assert limits[0] > limits[-1] + 4.0
    assert limits[30] > limits[-1] + 4.0


def test_signature_is_the_first_order_of_the_simulation() -> None:
    model, u = one_axis(), drive(2000)
    linear, places = model.linear(), places_of(model)
    position = simulate(discretise(linear, RATE_HZ), u)
    rate = np.gradient(position, 1.0 / RATE_HZ, axis=0)
    seen = Motion(u, position, position, rate, np.zeros_like(position), None)
    hidden = {"cubic-stiffness": {"stiffness": 20.0}, "coulomb-friction": {"torque": 1e-6, "breakaway_rate": 0.01}}
    for name, parameters in hidden.items():
        cls = effect_class(name)
        shapes = {k: v for k, v in parameters.items() if k in cls.shapes()}
        sizes = {k: v for k, v in parameters.items() if k in cls.sizes()}
        column = signature(
            Candidate(cls, "theta_x", shapes, sizes, shapes), linear, places, seen, RATE_HZ, np.zeros((2, 2))
        )[:, 0, 0]
        exact = replay(linear, [cls("theta_x", **parameters)], places, transducers_of(model), u, RATE_HZ, substeps=8)
        change = (exact.reading - position)[:, 0]
        # held over a sample, a motion-dependent torque acts half a sample late: pi f / rate = 5 % at 30 Hz
        assert np.linalg.norm(column - change) < 0.08 * np.linalg.norm(change), name


def test_descent_finds_what_scipy_finds() -> None:
    t = np.linspace(0, 1, 50)
    data = 2.0 * np.exp(-3.0 * t) + 0.01 * np.sin(40 * t)

    class Point:
        def __init__(self, x: np.ndarray) -> None:
            self.r = data - x[0] * np.exp(-x[1] * t)
            self.objective = float(self.r @ self.r) * 1e6

    def normal(x: np.ndarray, at: Point) -> tuple[np.ndarray, np.ndarray]:
        j = np.column_stack([np.exp(-x[1] * t), -x[0] * t * np.exp(-x[1] * t)])
        return 1e6 * j.T @ j, 1e6 * j.T @ at.r

    high = np.array([np.inf, 2.5])
    for upper in (np.full(2, np.inf), high):
        x, _ = Descent(Point, normal, -upper, upper, np.full(2, 1.0)).run(np.array([1.0, 1.0]), 50)
        expected = least_squares(lambda p: data - p[0] * np.exp(-p[1] * t), [1, 1], bounds=(-upper, upper)).x
        np.testing.assert_allclose(x, expected, rtol=1e-3)


def test_every_effect_is_tried_at_every_place_it_can_act() -> None:
    model, u = one_axis(), drive(2000)
    position = simulate(discretise(model.linear(), RATE_HZ), u)
    rate = np.gradient(position, 1.0 / RATE_HZ, axis=0)
    view = RecordView(
        RATE_HZ, u[:, 0], position[:, 0], rate[:, 0], 1e-6 * position[:, 0], np.linspace(70, 80, 2000), 30.0
    )
    scales = Scales(np.array([0.05]), np.array([1e-3]), 5e-3, 10.0)
    tried = {c.effect.name for c in enumerate_candidates(EFFECTS, places_of(model), {"theta_x": view}, scales)}
    assert {"cubic-stiffness", "coulomb-friction", "delay", "thermal-stiffness-drift", "amplifier-saturation"} <= tried
    assert "cross-coupling" not in tried  # one axis has nothing to couple to


def test_a_column_that_the_knobs_span_leaves_the_threshold_alone() -> None:
    rng = np.random.default_rng(8)
    knob, free, residual = rng.standard_normal((3, 400))
    spanned = 2.0 * knob + 1e-8 * rng.standard_normal(400)  # 1e-16 of its energy is left: rounding
    columns = np.stack([residual, knob, free, spanned], axis=1)
    gram = Gram(columns.T @ columns, 1, (np.array([2]), np.array([3])), (False, False), 400, True)
    maxima = gram.null_ratios(gram.without(gram.knob_columns()), np.random.default_rng(0), 4000).max(axis=0)
    # one live column: chi-squared with one degree of freedom, 99 % below 6.63; 4000 draws know that to 0.35
    assert np.quantile(maxima, 0.99) == pytest.approx(6.635, abs=1.1)


def test_what_only_the_prior_determines_keeps_its_deviation_beside_what_is_known_to_many_digits() -> None:
    """Two columns that are the same, 10⁴ strong, each with a prior of one; the third is known to 3e-8 of its prior.

    [[1 + a, a], [a, 1 + a]] has the inverse [[1 + a, -a], [-a, 1 + a]] / (1 + 2 a): half, and minus half.
    """
    a, strong = 1e8, 1e15
    precision = np.array([[1.0 + a, a, 0.0], [a, 1.0 + a, 0.0], [0.0, 0.0, strong]])
    covariance = inverse_of(precision)
    # the scaled matrix is known to 1e-16, its smallest eigenvalue is 1e-8
    np.testing.assert_allclose(covariance[:2, :2], [[0.5, -0.5], [-0.5, 0.5]], rtol=1e-7)
    assert covariance[2, 2] == pytest.approx(1.0 / strong)
