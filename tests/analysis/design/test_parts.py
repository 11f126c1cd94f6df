"""Noise, uncertainty, feedback, learning and moves of a design, each against a computation of its own."""

import control
import msgspec
import numpy as np
import pytest
from scipy import signal

from analysis.design.api import Options, _within
from analysis.design.expected import Motion
from analysis.design.feedback import (
    DISTRUSTS,
    EFFORTS_RAD_NM,
    PEAK_DB,
    QUIET,
    WORST_PEAK_DB,
    design_feedback,
    frequency_grid,
    largest_pole,
    three_sigma,
)
from analysis.design.learning import QUICK_GAIN, STEADY_GAINS, averaging_gains, design_learning
from analysis.design.moves import MARGIN, UNLEARNED, design_move
from analysis.design.noise import measure_noise
from analysis.design.price import affordable, price_curve
from analysis.design.uncertainty import MOST, Tolerance, drawn_plants
from analysis.measurements.power import coil_power
from analysis.measurements.settling import BAND_RAD
from analysis.recorded.requirements import STABILITY_RAD
from analysis.recorded.sweep import Sweep
from campaigns.benches import open_bench
from campaigns.strategies.design import Design
from campaigns.strategies.designed import move_over
from sim_backend.control.chop import Chop
from sim_backend.control.inversion import periodic_input, siso_matrices
from sim_backend.control.lqg import LinearQuadraticGaussian, Noise
from sim_backend.errors import ConfigError, DataError
from sim_backend.linear import discretise
from sim_backend.model import Quantity, from_linear, load_model

RATE_HZ = 10_000.0
NOISE = Noise(3.4e-5, 50.0, 1.1e-7)
MODEL = load_model("design")
PLANT = Design(MODEL, RATE_HZ).axis("theta_x")


def quiet(seconds, rng, noise=NOISE, plant=PLANT):
    """Reading of a plant at rest, simulated by scipy from two streams of numbers."""
    n = round(seconds * RATE_HZ)
    forget = np.exp(-2.0 * np.pi * noise.bandwidth_hz / RATE_HZ)
    torque = signal.lfilter([noise.torque_nm * np.sqrt(1.0 - forget**2)], [1.0, -forget], rng.standard_normal(n))
    a, b, c = siso_matrices(discretise(plant, RATE_HZ))
    y = signal.dlsim((a, b, c, [[0.0]], 1.0 / RATE_HZ), torque)[1][:, 0]
    return y + noise.reading_rad * rng.standard_normal(n)


def test_noise_comes_back_within_its_uncertainty():
    found = measure_noise(quiet(20.0, np.random.default_rng(3)), PLANT, RATE_HZ)
    logs = np.log(
        [
            found.noise.torque_nm / NOISE.torque_nm,
            found.noise.bandwidth_hz / NOISE.bandwidth_hz,
            found.noise.reading_rad / NOISE.reading_rad,
        ]
    )
    assert np.all(np.abs(logs) < 4.0 * found.relative_std)
    # half a million ordinates of the upper spectrum: 20 s know the reading noise to 1/sqrt(2 · 200,000) = 0.16 %
    assert 0.5e-3 < found.relative_std[2] < 3e-3


def test_twice_the_noise_is_twice_the_noise():
    y = quiet(20.0, np.random.default_rng(4))
    once, twice = measure_noise(y, PLANT, RATE_HZ).noise, measure_noise(2.0 * y, PLANT, RATE_HZ).noise
    for name in ("torque_nm", "reading_rad"):
        # the search ends where its simplex is 1e-4 wide
        assert getattr(twice, name) == pytest.approx(2.0 * getattr(once, name), rel=1e-3)


def test_a_short_record_is_refused_in_seconds():
    short = np.random.default_rng(4).normal(size=round(5.0 * RATE_HZ))
    with pytest.raises(DataError, match=r"lasts 5 s, and a design needs 8 s or more.*duration_s=8 or more") as found:
        measure_noise(short, PLANT, RATE_HZ)
    assert "shape" not in str(found.value) and "axis 0" not in str(found.value)


def model_of(plant, std=None):
    """The model file of a plant of θx, with the deviations that it states."""
    return from_linear(
        plant,
        name="m",
        title="",
        sample_rate_hz=RATE_HZ,
        inputs=MODEL.inputs[:1],
        outputs=MODEL.outputs[:1],
        origin="fitted",
        source="test",
        std=std,
    )


def test_plants_are_drawn_within_what_the_file_states_and_the_tolerance_adds():
    std = PLANT.with_(
        omega_rad_s=0.003 * PLANT.omega_rad_s,
        sigma_1_s=0.04 * PLANT.sigma_1_s,
        c=0.01 * PLANT.c,
    )
    stated = model_of(PLANT, std)
    tolerance = Tolerance(frequency=0.004, suspension=0.0, damping=0.03, participation=0.0)
    drawn = drawn_plants(stated, "theta_x", tolerance, 4001, np.random.default_rng(0))
    np.testing.assert_array_equal(drawn[0].omega_rad_s, PLANT.omega_rad_s)
    omega = np.stack([p.omega_rad_s for p in drawn[1:]]) / PLANT.omega_rad_s
    sigma = np.stack([p.sigma_1_s for p in drawn[1:]]) / PLANT.sigma_1_s
    # scatter of 0.3 % and 0.4 % either way, 4 % and 3 %; a uniform number has its width over √12 as standard deviation,
    # and 4000 draws know one to 1.1 %
    np.testing.assert_allclose(omega.std(axis=0), np.hypot(0.003, 0.004 / np.sqrt(3.0)), rtol=0.05)
    np.testing.assert_allclose(sigma.std(axis=0), np.hypot(0.04, 0.03 / np.sqrt(3.0)), rtol=0.05)
    # the model has neither delay nor lag: a sample of delay and 1 kHz of amplifier may be missing, nothing may be early
    late = np.array([p.delay_s[0] for p in drawn[1:]]) * RATE_HZ
    assert late.min() >= 0.0 and late.max() <= 1.0 + RATE_HZ / (2.0 * np.pi * 1000.0)
    assert late.mean() == pytest.approx(0.5 + 0.5 * RATE_HZ / (2.0 * np.pi * 1000.0), rel=0.05)
    known = model_of(PLANT.with_(delay_s=np.array([3e-4])))
    some = [p.delay_s[0] * RATE_HZ for p in drawn_plants(known, "theta_x", tolerance, 200, np.random.default_rng(0))]
    assert some[0] == pytest.approx(3.0) and 2.0 <= min(some) < 2.1 and 3.9 < max(some) <= 4.0
    assert isinstance(stated.modes[0].frequency_hz, Quantity)


def test_an_absurd_tolerance_is_refused():
    with pytest.raises(ConfigError, match="damping is 0.7"):
        Tolerance(damping=0.7)


@pytest.fixture(scope="module")
def plants():
    return drawn_plants(MODEL, "theta_x", Tolerance(frequency=0.002), 12, np.random.default_rng(1))


@pytest.fixture(scope="module")
def feedback(plants):
    return design_feedback(plants, NOISE, RATE_HZ)


def test_every_drawn_plant_keeps_the_peak_and_is_stable(plants, feedback):
    k = control.ss(*feedback.controller.state_space(), 1.0 / RATE_HZ)
    f = np.geomspace(1.0, 4990.0, 4000)
    z = np.exp(2j * np.pi * f / RATE_HZ)
    peaks: list[float] = []
    for plant in plants:
        p = control.ss(*siso_matrices(discretise(plant, RATE_HZ)), [[0.0]], 1.0 / RATE_HZ)
        peaks.append(20.0 * np.log10(np.max(1.0 / np.abs(1.0 + p(z) * k(z)))))
        assert np.max(np.abs(control.feedback(p * k).poles())) < 1.0
        assert largest_pole(plant, feedback.controller, RATE_HZ) < 1.0
    assert peaks[0] < PEAK_DB + 0.01 and np.quantile(peaks, MOST) < WORST_PEAK_DB + 0.01


def test_margins_are_python_controls(plants, feedback):
    p = control.ss(*siso_matrices(discretise(plants[0], RATE_HZ)), [[0.0]], 1.0 / RATE_HZ)
    k = control.ss(*feedback.controller.state_space(), 1.0 / RATE_HZ)
    f = np.geomspace(0.5, 4990.0, 20_000)
    response = control.frd(p(np.exp(2j * np.pi * f / RATE_HZ)) * k(np.exp(2j * np.pi * f / RATE_HZ)), 2.0 * np.pi * f)
    _, phase, *_ = control.stability_margins(response)
    assert feedback.margins.phase_margin_deg == pytest.approx(phase, abs=0.1)


def test_the_predicted_scatter_is_what_a_simulated_loop_shows(plants, feedback):
    rng = np.random.default_rng(5)
    n = 400_000
    forget = NOISE.forget(RATE_HZ)
    torque = signal.lfilter([NOISE.torque_nm * np.sqrt(1.0 - forget**2)], [1.0, -forget], rng.standard_normal(n))
    a, b, c = siso_matrices(discretise(plants[0], RATE_HZ))
    ac, bc, cc, dc = feedback.controller.state_space()
    whole = np.block([[a - b @ dc @ c, b @ cc], [-bc @ c, ac]])
    into = np.block([[b, -b @ dc], [np.zeros((ac.shape[0], 1)), -bc]])
    v = NOISE.reading_rad * rng.standard_normal(n)
    out = np.hstack([c, np.zeros((1, ac.shape[0]))])
    y = signal.dlsim((whole, into, out, [[0.0, 1.0]], 1.0 / RATE_HZ), np.stack([torque, v], axis=1))[1][:, 0]
    # its low part has some 50 Hz of bandwidth: 40 s know the variance to sqrt(2 / (2 · 50 · 40)), σ to half of 2 %
    assert 3.0 * y[10_000:].std() == pytest.approx(feedback.three_sigma_rad[0], rel=0.04)


def test_the_chosen_feedback_is_better_than_a_cautious_one_and_not_below_the_bound(plants, feedback):
    f = frequency_grid(plants[0], RATE_HZ)
    p = discretise(plants[0], RATE_HZ).frequency_response(f)[:, 0, 0][None]
    cautious = LinearQuadraticGaussian(plants[0], NOISE, RATE_HZ).controller(1e-2, 10.0).frequency_response(f)
    assert feedback.three_sigma_rad[0] < three_sigma(f, p, cautious, NOISE, RATE_HZ)[0]
    assert feedback.three_sigma_rad[0] > feedback.least_rad > 3.0 * NOISE.reading_rad
    shares = np.hypot(feedback.from_torque_rad, feedback.from_reading_rad)
    assert shares == pytest.approx(feedback.three_sigma_rad[0], rel=1e-9)


def test_a_loud_bench_has_weights_between_those_of_the_grid(plants):
    loud = Noise(4.0 * NOISE.torque_nm, NOISE.bandwidth_hz, 4.0 * NOISE.reading_rad)
    found = design_feedback(plants, loud, RATE_HZ)
    assert found.three_sigma_rad.max() > QUIET * STABILITY_RAD
    f = frequency_grid(plants[0], RATE_HZ)
    p = np.stack([discretise(plant, RATE_HZ).frequency_response(f)[:, 0, 0] for plant in plants])
    best = np.inf
    for effort in EFFORTS_RAD_NM:
        for distrust in DISTRUSTS:
            k = LinearQuadraticGaussian(plants[0], loud, RATE_HZ).controller(effort, distrust).frequency_response(f)
            peaks = 20.0 * np.log10(np.max(1.0 / np.abs(1.0 + p * k), axis=1))
            if peaks[0] <= PEAK_DB and np.quantile(peaks, MOST) <= WORST_PEAK_DB:
                best = min(best, float(three_sigma(f, p, k, loud, RATE_HZ).max()))
    assert found.three_sigma_rad.max() < best < np.inf
    assert found.peak_db[0] <= PEAK_DB and np.quantile(found.peak_db, MOST) <= WORST_PEAK_DB


def test_a_move_beyond_a_limit_is_left_out_and_the_reason_told_where_none_is_left(curve):
    currents = [one.peak_a for one in curve]
    most_a = float(np.median(currents))
    assert [one.peak_a for one in _within(curve, np.inf, most_a)] == [a for a in currents if a <= most_a]
    with pytest.raises(ConfigError, match="peak current would be .* A, the limit is 0.01 A"):
        list(_within(curve, np.inf, 0.01))
    with pytest.raises(ConfigError, match="dissipates more than 1e-06 W"):
        list(_within(curve, 1e-6, most_a))


def test_a_plant_that_nobody_knows_is_refused():
    wild = drawn_plants(
        MODEL, "theta_x", Tolerance(frequency=0.3, damping=0.4, participation=0.45), 30, np.random.default_rng(2)
    )
    with pytest.raises(ConfigError, match="dB at best.* the limits are 8 and 6 dB"):
        design_feedback(wild, NOISE, RATE_HZ)


def swept(plant, relative):
    f = np.arange(5.0, 2000.0, 15.0)
    response = discretise(plant, RATE_HZ).frequency_response(f)[:, 0, 0]
    return Sweep("theta_x", f, response, 2.0 * (relative * np.abs(response)) ** 2, np.ones(f.size))


@pytest.fixture(scope="module")
def motion():
    """One period of a 5 Hz chop and its feed-forward on the identified plant."""
    move = design_move(PLANT, 8.5e-3, 5e-3, 700.0, RATE_HZ)
    way = move_over(Chop((8.5e-3, 0.0), 1000, RATE_HZ), lambda _: move.n_samples, move.concentration, "theta_x")
    return Motion.of(way, periodic_input(PLANT, way, RATE_HZ), 50)


def test_gains_take_a_part_and_then_average():
    assert averaging_gains(9) == (*[1.0] * 6, 1.0 / 2.0, 1.0 / 3.0, 1.0 / 4.0)
    # what is learned with a half is a mean of two already
    assert averaging_gains(15, 0.5, 0.5) == (*[0.5] * 12, 1.0 / 3.0, 1.0 / 4.0, 1.0 / 5.0)
    assert averaging_gains(15, 0.5, 0.9) == (0.9, 0.9, *[0.5] * 10, 1.0 / 3.0, 1.0 / 4.0, 1.0 / 5.0)
    assert averaging_gains(2, 0.5, 0.9) == (0.9, 0.5)


def test_convergence_is_proven_at_the_measured_lines(plants, feedback, motion):
    grid = frequency_grid(plants[0], RATE_HZ)
    made = design_learning(plants, feedback.controller, grid, swept(plants[0], 0.001), 12, [1000.0], motion)
    quick, steady = made.gains[0], made.gains[2]
    assert quick == QUICK_GAIN and steady in STEADY_GAINS and made.gains == averaging_gains(12, steady, quick)
    assert made.grown <= 1.0 and np.all(made.factor <= made.worst + 1e-12) and not made.refusal
    lines = made.lines_hz
    assert lines is not None and made.at_lines is not None and made.at_lines_worst is not None
    z = np.exp(2j * np.pi * lines / RATE_HZ)
    p = control.ss(*siso_matrices(discretise(plants[0], RATE_HZ)), [[0.0]], 1.0 / RATE_HZ)(z)
    k = control.ss(*feedback.controller.state_space(), 1.0 / RATE_HZ)(z)
    learned = steady * z**made.lead_samples * made.filter.frequency_response(lines)
    left = 1.0 - p / (1.0 + p * k) * learned
    taps = np.array(made.taps)
    q = (np.exp(-2j * np.pi * np.outer(lines, np.arange(taps.size) - taps.size // 2) / RATE_HZ) @ taps).real
    np.testing.assert_allclose(made.at_lines, np.abs(q * left), atol=1e-6)
    # an error of P by two standard deviations in the worst direction is within the bound: |dS_p| ≈ |dP| / |1 + P C|²
    worse = 1.0 - p * 1.002 / (1.0 + p * 1.002 * k) * learned
    assert np.all(np.abs(q * worse) <= made.at_lines_worst * 1.01 + 1e-6)


def test_a_measured_response_that_contradicts_the_model_is_refused(plants, feedback, motion):
    grid = frequency_grid(plants[0], RATE_HZ)
    other = plants[0].with_(c=-plants[0].c)
    with pytest.raises(ConfigError, match="learning below 1000 Hz.*by the swept response, the limit is 1"):
        design_learning(plants, feedback.controller, grid, swept(other, 0.001), 6, [1000.0], motion)


def test_errors_are_expected_as_a_simulated_loop_learns(plants, feedback, motion):
    """Sample by sample, by scipy: each period is played until it repeats, then its error is learned from."""
    made = design_learning(plants, feedback.controller, frequency_grid(plants[0], RATE_HZ), None, 12, [1000.0], motion)
    n, late = motion.reference.size, plants[3]
    a, b, c = siso_matrices(discretise(late, RATE_HZ))
    ac, bc, cc, dc = feedback.controller.state_space()
    whole = np.block([[a - b @ dc @ c, b @ cc], [-bc @ c, ac]])
    into = np.block([[b, b @ dc], [np.zeros((ac.shape[0], 1)), bc]])
    loop = whole, into, np.hstack([c, np.zeros((1, ac.shape[0]))]), [[0.0, 0.0]], 1.0 / RATE_HZ
    al, bl, cl, dl = made.filter.state_space()
    taps, learned, after = np.array(made.taps), np.zeros(n), []
    error = motion.reference
    for gain in (0.0, *made.gains):
        if gain:
            filtered = signal.dlsim((al, bl, cl, dl, 1.0 / RATE_HZ), np.tile(error, 20))[1][-n:, 0]
            tried = learned + gain * np.roll(filtered, -made.lead_samples)
            around = np.concatenate([tried[-(taps.size // 2) :], tried, tried[: taps.size // 2]])
            learned = np.convolve(around, taps, "valid")
        drives = np.stack([np.tile(motion.drive + learned, 20), np.tile(motion.reference, 20)], axis=1)
        error = motion.reference - signal.dlsim(loop, drives)[1][-n:, 0]
        after.append(np.max(np.abs(error[motion.after])))
    # a hundredth of the band in which a chop has settled
    np.testing.assert_allclose(made.expected.after_rad[:, 3], after, rtol=1e-3, atol=0.01 * BAND_RAD)


def test_the_move_arrives_in_time_within_the_learned_band():
    move = design_move(PLANT, 8.5e-3, 5e-3, 700.0, RATE_HZ)
    assert move.arrival_s <= MARGIN * 5e-3
    assert move.unlearned_rad <= UNLEARNED * BAND_RAD
    # no more than the bang-bang torque of the inertia alone times what smoothness costs, no less than it: 4 J d / T²
    inertia = 1.0 / float(PLANT.b[0, 0] * PLANT.c[0, 0])
    bang = 4.0 * inertia * 8.5e-3 / move.arrival_s**2
    assert bang < move.peak_nm < 5.0 * bang


def test_a_move_that_cannot_be_learned_in_time_is_refused():
    with pytest.raises(ConfigError, match="above 400 Hz.*allow more time"):
        design_move(PLANT, 8.5e-3, 5e-3, 400.0, RATE_HZ)


def test_real_poles_of_an_amplifier_move_together_at_the_same_gain_at_rest():
    lag = 2.0 * np.pi * 1000.0
    slow = MODEL.modes[0]
    pole = msgspec.structs.replace(
        slow,
        label="amplifier",
        frequency_hz=Quantity(value=50.0, origin="fitted", source="test", std=20.0),
        decay_rate_1_s=Quantity(value=0.5 * lag, origin="fitted", source="test", std=1000.0),
    )
    model = msgspec.structs.replace(MODEL, modes=[pole, *MODEL.modes])
    nominal, *drawn = drawn_plants(model, "theta_x", Tolerance(participation=0.0), 300, np.random.default_rng(0))
    at = int(np.flatnonzero(nominal.sigma_1_s > nominal.omega_rad_s)[0])
    ratio = np.array([p.sigma_1_s[at] / p.omega_rad_s[at] for p in drawn])
    np.testing.assert_allclose(ratio, nominal.sigma_1_s[at] / nominal.omega_rad_s[at], rtol=1e-12)
    rest = np.array([p.c[0, at] / p.omega_rad_s[at] ** 2 for p in drawn])
    np.testing.assert_allclose(rest, nominal.c[0, at] / nominal.omega_rad_s[at] ** 2, rtol=1e-12)
    # by the tolerance of damping, 20 % either way; 300 draws know a standard deviation to 4 %
    scatter = np.std([p.sigma_1_s[at] for p in drawn]) / nominal.sigma_1_s[at]
    assert scatter == pytest.approx(0.2 / np.sqrt(3.0), rel=0.16)


@pytest.fixture(scope="module")
def curve():
    return price_curve(Design(MODEL, RATE_HZ), "theta_x", 8.5e-3, open_bench("sim", 0).limits, 0)


def test_the_slowest_move_is_the_cheapest_and_a_price_is_that_of_its_currents(curve):
    assert len(curve) > 6
    arrivals, powers = [one.move.arrival_s for one in curve], [one.power_w for one in curve]
    assert arrivals == sorted(arrivals) and powers[0] == max(powers) and powers[-1] == min(powers)
    limits = open_bench("sim", 0).limits
    for one in curve:
        current = limits.to_current @ np.stack([one.drive_nm, 0.0 * one.drive_nm, 0.0 * one.drive_nm])
        power = coil_power(current.T, 5.7, 7.9)
        assert power.total_w == pytest.approx(one.power_w, rel=1e-9) and power.peak_a == pytest.approx(one.peak_a)


def test_the_fastest_affordable_point_is_taken(curve):
    for most_w in (0.5, 0.2, 0.1):
        taken = affordable(curve, most_w)
        faster = curve[: [one.allowed_s for one in curve].index(taken.allowed_s)]
        assert taken.power_w <= most_w and all(one.power_w > most_w for one in faster)
    with pytest.raises(ConfigError, match="allow more or give a smaller stroke"):
        affordable(curve, 0.5 * curve[-1].power_w)


def test_a_time_of_too_few_samples_is_told_as_such():
    with pytest.raises(ConfigError, match="0 samples at 10000 Hz are too few"):
        design_move(PLANT, 8.5e-3, 1e-6, 700.0, RATE_HZ)


def test_a_bench_without_noise_is_refused():
    with pytest.raises(DataError, match="never changes"):
        measure_noise(np.zeros(200_000), PLANT, RATE_HZ)


@pytest.mark.parametrize(("settings", "says"), [({"settling_s": 2.0}, "limit is 0.1"), ({"most_w": 0.0}, "above zero")])
def test_options_that_cannot_be_are_refused(settings, says):
    with pytest.raises(ConfigError, match=says):
        Options(**settings)
