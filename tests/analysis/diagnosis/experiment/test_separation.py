"""What an experiment is predicted to separate, against fits of the hypotheses themselves."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from scipy.optimize import least_squares

from analysis.diagnosis.candidates.signature import Candidate, Scales, unit_sizes
from analysis.diagnosis.experiment.hypotheses import Hypothesis
from analysis.diagnosis.experiment.planned import Headroom, Played, play_as, records_motion
from analysis.diagnosis.experiment.reference_sensor import ReferenceSensor, whitened_error
from analysis.diagnosis.experiment.separation import information, left_over, prediction, separation, with_spread
from analysis.diagnosis.fitting.fit import Setting
from analysis.diagnosis.fitting.refit import refit
from analysis.diagnosis.fitting.starts import starts_of
from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.nominal.tuning import nuisances_of, own_nuisances_of, turned
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from campaigns.plans import make_plan
from sim_backend.assembly import places_of, transducers_of
from sim_backend.effects import effect_class, make_effect
from sim_backend.model import Mode, Model, Port
from sim_backend.replay import replay
from sim_backend.simbench import SimBench
from tests.small_bench import bench_model

RATE_HZ = 1000.0
NOISE_RAD = 1e-6
INERTIA = 3.23e-4


def one_axis() -> Model:
    mode = Mode(label="a", frequency_hz=30.0, decay_rate_1_s=5.0, input={"u": 1.0 / INERTIA}, output={"y": 1.0})
    return Model(
        name="one axis",
        sample_rate_hz=RATE_HZ,
        inputs=[Port(name="u", unit="N m", dof="theta_x")],
        outputs=[Port(name="y", unit="rad", dof="theta_x")],
        modes=[mode],
    )


def sine(torque_nm: float, hz: float, rows: int) -> np.ndarray:
    return torque_nm * np.sin(2 * np.pi * hz * np.arange(rows) / RATE_HZ)[:, None]


def read(model: Model, u: np.ndarray, effects, linear=None, start=None) -> np.ndarray:
    linear = linear or model.linear()
    return replay(linear, effects, places_of(model), transducers_of(model), u, RATE_HZ, start=start).reading


def setting_of(model: Model, u: np.ndarray, y: np.ndarray, noise: float = NOISE_RAD) -> Setting:
    data = Dataset(model.sample_rate_hz, (Record("old", u, y, (Window("all", 0, u.shape[0]),)),))
    linear = model.linear()
    whitener = Whitener(np.full((y.shape[1], 1), 1.0 / noise), True)
    starts = starts_of(data, linear, whitener)
    rest = (np.zeros((linear.n_blocks, 2)),)
    nuisances = nuisances_of(linear, 0.01)
    return Setting(
        data,
        linear,
        (),
        places_of(model),
        transducers_of(model),
        nuisances,
        whitener,
        starts,
        rest,
        substeps=1,
        workers=1,
    )


def hypothesis(model: Model, setting: Setting, name: str, std: float = 0.0, **sizes: float) -> Hypothesis:
    """A fit with this one effect, every nominal number as it is."""
    cls = effect_class(name)
    n_y, n_u = len(model.outputs), len(model.inputs)
    scales = Scales(np.full(n_u, 0.01), np.full(n_y, 1e-3), 1e-2, 10.0)
    units = unit_sizes(cls, "theta_x", setting.places, scales)
    candidate = Candidate(cls, "theta_x", {}, units, {})
    start = np.array([sizes[n] / unit for n, unit in units.items()])
    fit = refit(setting, [candidate], start, np.zeros(len(setting.nuisances)))
    effect = make_effect(name, "theta_x", sizes)
    values = np.array([sizes[n] for n in units])
    change = np.zeros(len(setting.nuisances))
    return Hypothesis(
        (name,), replace(fit, effects=(effect,), values=values, std=np.full(values.size, std), change=change)
    )


def test_a_hypothesis_is_played_with_every_re_tuned_number():
    """Of a model that was fitted to the very runs the direct path is re-tuned as well."""
    model = msgspec.structs.replace(one_axis(), feedthrough={"y": {"u": 1e-3}})
    u = sine(0.02, 1.0, 200)
    fitted = setting_of(model, u, read(model, u, []))
    setting = replace(fitted, nuisances=own_nuisances_of(fitted.nominal))
    change = np.linspace(-0.3, 0.2, len(setting.nuisances))
    made = hypothesis(model, setting, "cubic-stiffness", stiffness=2500.0)
    found = replace(made, fit=replace(made.fit, change=change)).model(model, setting).linear()
    wanted = turned(setting.nominal, setting.nuisances, change)
    assert wanted.d[0, 0] != 1e-3
    for name in ("omega_rad_s", "sigma_1_s", "b", "b_direct", "c", "c_rate", "d", "delay_s"):
        np.testing.assert_allclose(getattr(found, name), getattr(wanted, name), rtol=1e-12, err_msg=name)


def test_what_is_left_over_is_that_of_stacked_least_squares(rng):
    columns, difference = rng.standard_normal((50, 4)), rng.standard_normal(50)
    root = rng.standard_normal((4, 4))
    stacked = np.vstack([columns, root])
    target = np.concatenate([difference, np.zeros(4)])
    expected = np.linalg.norm(target - stacked @ np.linalg.lstsq(stacked, target)[0])
    assert left_over(difference, columns, root.T @ root) == pytest.approx(expected, rel=1e-9)


def test_the_separation_is_what_a_joint_fit_of_old_and_new_data_leaves():
    """The definition itself, by scipy: the wrong cause fitted in full simulation to both records at once."""
    model = one_axis()
    old_u, new_u = sine(0.02, 1.0, 1500), sine(0.01, 21.0, 1500)
    truth = make_effect("position-dependent-force-constant", "theta_x", {"quadratic": -250.0})
    cubic = {"stiffness": 2500.0}
    rival = make_effect("cubic-stiffness", "theta_x", cubic)
    old_y, new_y = read(model, old_u, [rival]), read(model, new_u, [truth])
    setting = setting_of(model, old_u, old_y)
    second = hypothesis(model, setting, "cubic-stiffness", **cubic)

    record = Record("new", new_u, new_y, (Window("all", 0, 1500),))
    expected = prediction(setting, second, record)
    found = separation(setting, record, expected, information(setting, second))

    sd = np.array([k.sd for k in setting.nuisances])

    def residuals(x: np.ndarray) -> np.ndarray:
        linear = turned(setting.nominal, setting.nuisances, x[: sd.size] * sd)
        effect = make_effect("cubic-stiffness", "theta_x", {"stiffness": cubic["stiffness"] * (1.0 + x[sd.size])})
        parts = [x[: sd.size]]
        for i, (u, y) in enumerate(((old_u, old_y), (new_u, new_y))):
            start = 1e-4 * x[sd.size + 1 + 2 * i :][:2].reshape(1, 2) * [1.0, 200.0]
            parts.append((y - read(model, u, [effect], linear, start)).ravel() / NOISE_RAD)
        return np.concatenate(parts)

    joint = least_squares(residuals, np.zeros(sd.size + 5), x_scale="jac", xtol=1e-12, ftol=1e-12)
    direct = np.sqrt(2.0 * joint.cost)
    assert 5.0 < direct < 500.0
    # both take the rival as linear about its fit, which it is but for the square of relative changes of some per cent
    assert found == pytest.approx(direct, rel=0.05)


def test_an_experiment_that_repeats_the_old_one_separates_nothing_new():
    """Two gains of one axis: whatever is played, the readings are the same, and the fit of one explains the other."""
    model = one_axis()
    u = sine(0.02, 7.0, 1500)
    y = read(model, u, [make_effect("actuator-gain", "theta_x", {"relative": 0.1})])
    setting = setting_of(model, u, y)
    second = hypothesis(model, setting, "sensor-gain", relative=0.1)
    record = Record("new", 3.0 * u, 3.0 * y, (Window("all", 0, 1500),))
    expected = prediction(setting, second, record)
    # 10 % of 2 mrad are 200 times the noise; rounding of the replays is all that is left
    assert separation(setting, record, expected, information(setting, second)) < 1e-3


def test_standard_deviations_follow_from_what_is_known():
    model = one_axis()
    u = sine(0.02, 7.0, 1500)
    setting = setting_of(model, u, read(model, u, [make_effect("cubic-stiffness", "theta_x", {"stiffness": 2500.0})]))
    found = hypothesis(model, setting, "cubic-stiffness", stiffness=2500.0)
    spread = with_spread(setting, found, information(setting, found))
    # the search's own covariance, which is tested against scipy, of a fit of the same data
    candidate, start = found.fit.held()
    exact = refit(setting, candidate, start, np.zeros(len(setting.nuisances)), exact=True)
    # the nuisances' columns are found with the torque held, which leaves out the spring's share of the stiffness: up to
    # 3 · 2500 N m/rad³ · (2 mrad)² / 11.4 N m/rad = 0.3 %, on either of two parameters that trade
    np.testing.assert_allclose(spread.fit.std, exact.std, rtol=6e-3)


def watched(model: Model) -> Model:
    assert model.hardware is not None
    hardware = msgspec.structs.replace(model.hardware, theodolite_noise_rad=2.5e-6)
    return msgspec.structs.replace(model, hardware=hardware, sample_rate_hz=5000.0)


def gains(std: float):
    model = watched(bench_model())
    u = np.zeros((100, 3))
    setting = setting_of(model, u, np.zeros((100, 3)), 1e-8)
    setting = replace(setting, data=replace(setting.data, records=(replace(setting.data.records[0], u=u),)))
    both = [hypothesis(model, setting, n, std, relative=0.1) for n in ("sensor-gain", "actuator-gain")]
    plan = make_plan("theodolite", {"x_rad": [-5e-3, 5e-3], "y_rad": [0.0], "settle_s": 0.3})
    bench, headroom = SimBench(model, 0), Headroom(np.array([0.01, 0.01, 1e-3]), 9.0)
    played = [play_as(plan, bench, model, h, setting, headroom) for h in both]
    return ReferenceSensor(plan, bench, model, setting, headroom), both, played


def test_an_instrument_separates_two_gains_as_far_as_the_gain_is_known():
    std = 0.01
    sensor, both, played = gains(std)
    assert not records_motion(sensor.plan, sensor.bench, sensor.model)
    # a sensor's gain can shrink to nothing, which its standard deviation makes 0.1 / 0.01 = 10 sigma unlikely; the
    # instrument sees that 10 mrad times 0.1 is nothing to thousands of sigma, so that is all the doubt there is
    assert sensor.separation(played[1], both[0]) == pytest.approx(0.1 / std, rel=1e-3)


def test_an_instrument_sees_a_sensors_gain_in_closed_form():
    sensor, both, played = gains(0.01)
    # the loop holds the reading at the reference r, so reading minus angle is r g / (1 + g); nothing of the drive's
    # gain shows there, and the offset is free
    reading = played[0].record.y[:, 0]
    error = (reading - reading.mean()) * 0.1 / 1.1
    expected = np.sqrt(np.sum(error**2) / (2.5e-6**2 + 1e-8**2))
    assert sensor.separation(played[0], both[1]) == pytest.approx(expected, rel=1e-6)


def test_the_error_of_an_instrument_is_whitened_to_unit_variance(rng):
    model = watched(bench_model())
    taps = np.tile(np.array([1.0, -0.9]) / 4e-6, (3, 1))
    n = 40_000
    noise = np.zeros(n)
    for k, e in enumerate(4e-6 * rng.standard_normal(n)):
        noise[k] = 0.9 * noise[k - 1] + e
    error = (noise + 2.5e-6 * rng.standard_normal(n))[:, None]
    white = whitened_error(error, (0,), Whitener(taps, True), model)
    # n - 1 squares, so that their mean scatters by sqrt(2/n) = 0.7 %
    assert np.sum(white**2) / (n - 1) == pytest.approx(1.0, abs=0.03)
    # and flat: the lowest tenth of the lines as much as any other
    power = white[: n - 1] ** 2 + white[n - 1 :] ** 2
    assert np.mean(power[: n // 20]) == pytest.approx(1.0, abs=0.1)


def test_a_plan_that_leaves_the_limits_under_a_hypothesis_is_no_proposal():
    sensor, both, _ = gains(0.01)
    plan = make_plan("freerun", {"axes": ["theta_x"], "torque_nm": 0.05, "steps_s": 0.5, "noise_s": 0.1})
    args = (sensor.bench, sensor.model, both[0], sensor.setting)
    played = play_as(plan, *args, Headroom(np.array([0.01, 0.01, 1e-3]), 9.0))
    assert isinstance(played, Played) and records_motion(plan, sensor.bench, sensor.model)
    peak = float(np.max(np.abs(played.position[:, 0])))
    near = Headroom(np.array([peak / 0.91, 0.01, 1e-3]), 9.0)
    assert play_as(plan, *args, near) is None
    assert play_as(plan, *args, Headroom(np.array([0.01, 0.01, 1e-3]), 0.01)) is None
    assert [w.held_out for w in played.record.windows] == [False, False, True, True]
