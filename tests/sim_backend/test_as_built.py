"""The bench as built: what it shows when it is played, against closed forms and the paper's plants computed anew."""

import itertools
import tomllib
from dataclasses import replace
from importlib import resources

import msgspec
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sim_backend.bench import Gate, Learning, Segment
from sim_backend.control.chop import Chop
from sim_backend.control.feedback import theta_controller, z_controller
from sim_backend.control.feedforward import least_norm
from sim_backend.control.hybrid import hybrid
from sim_backend.control.profile import MotionLimits
from sim_backend.control.repetitive import TABLE_6_5, learning_filter
from sim_backend.model import bundled_models, load_model, number
from sim_backend.simbench import SimBench
from tests.sim_backend import paper_plants

RATE_HZ = 10_000.0
NOISES = ("amplifier-noise", "sensor-noise", "apex-noise")
AXES = ("theta_x", "theta_y")


def as_built(*without):
    model = load_model("as-built")
    return msgspec.structs.replace(model, effects=[e for e in model.effects if e.effect not in without])


def effect(name, where):
    found = next(e for e in load_model("as-built").effects if e.effect == name and e.where == where)
    return {k: number(v) for k, v in found.parameters.items()}


def play(bench, n, *, feedforward=None, reference=None, record=(), **more):
    rest = np.zeros((1, 3))
    wave = rest if feedforward is None else feedforward
    target = np.zeros_like(wave) if reference is None else reference
    wave = np.zeros_like(target) if feedforward is None else wave
    return bench.play(Segment("test", n, target, wave, record=record, **more)).channels


# origins


def numbers_without_origin(node, path):
    if isinstance(node, dict) and "value" in node:
        if node.get("origin", "stated") == "stated" or not node.get("source"):
            yield path
    elif isinstance(node, dict):
        for key, value in node.items():
            yield from numbers_without_origin(value, f"{path}.{key}")
    elif isinstance(node, list):
        for i, value in enumerate(node):
            yield from numbers_without_origin(value, f"{path}[{i}]")
    elif isinstance(node, (int, float)):
        yield path


@pytest.mark.parametrize("name", bundled_models())
def test_every_number_says_where_it_comes_from(name):
    text = (resources.files("sim_backend") / "models" / f"{name}.toml").read_text(encoding="utf-8")
    tables = tomllib.loads(text)
    assert tables.pop("sample_rate_hz") == RATE_HZ  # the clock for which everything else holds
    assert list(numbers_without_origin(tables, name)) == []


def test_a_number_without_origin_would_be_found():
    assert list(
        numbers_without_origin({"a": 1.0, "b": {"value": 2.0}, "c": [{"value": 3.0, "origin": "printed"}]}, "m")
    )


# the linear models against Table 6.2

FREQUENCY_HZ = np.concatenate([np.geomspace(0.1, 4900.0, 400), [29.56, 123.25, 489.5, 1440.0, 1999.9]])


@pytest.mark.parametrize(
    ("name", "input_", "output", "plant"),
    [
        ("printed", 0, 0, paper_plants.theta_x_printed),
        ("printed", 1, 1, paper_plants.theta_y),
        ("printed", 2, 2, paper_plants.z_axis),
        ("design", 0, 0, paper_plants.theta_x),
        ("design", 1, 1, paper_plants.theta_y),
        ("design", 2, 2, paper_plants.z_axis),
        ("design-4th-order", 1, 1, paper_plants.theta_y),
        ("table-6.4-30", 0, 0, paper_plants.theta_x_part),
        ("table-6.4-30-125", 0, 0, lambda: paper_plants.theta_x_part(125.0)),
        ("table-6.4-30-500", 0, 0, lambda: paper_plants.theta_x_part(485.0)),
    ],
)
def test_linear_models_are_table_6_2(name, input_, output, plant):
    ours = load_model(name).linear().frequency_response(FREQUENCY_HZ)[:, output, input_]
    theirs = plant().frequency_response(FREQUENCY_HZ)[:, 0, 0]
    # twelve digits in the file; the modes cancel each other by a factor of 1e3 above their own frequencies
    np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-9 * abs(theirs[0]))


def test_fourth_order_design_is_two_factors_in_series():
    f = FREQUENCY_HZ
    s = 2j * np.pi * f

    def factor(pole):
        return abs(pole) ** 2 / ((s - pole) * (s - pole.conjugate()))

    low = paper_plants.roots_near(paper_plants.THETA_X_DEN, 29.6)[0]
    expected = paper_plants.STATIC_GAIN * factor(low) * factor(paper_plants.pole_pair(1440.0, 34.0)[0])
    for name in ("design-4th-order", "table-6.4-30-1500"):
        ours = load_model(name).linear().frequency_response(f)[:, 0, 0]
        np.testing.assert_allclose(ours, expected, rtol=1e-8, atol=1e-9 * abs(expected[0]))


# at rest, iron, springs


def test_quiet_bench_rests_at_exactly_zero():
    channels = play(SimBench(as_built(*NOISES), 0), 2000)
    for name in (*AXES, "z", "head_s1", "head_s2", "head_s3", "current_a1"):
        assert not np.any(channels[name]), name


def loop(dof, torque_nm, rate_hz=0.05):
    """Return torque and reading over the second period of a slow sine: 0.05 Hz keeps the viscous lag below 1e-4."""
    n = int(RATE_HZ / rate_hz)
    wave = np.zeros((n, 3))
    wave[:, AXES.index(dof)] = torque_nm * np.sin(2 * np.pi * np.arange(n) / n)
    quiet = SimBench(as_built(*NOISES), 0)
    angle = play(quiet, 2 * n, feedforward=wave, record=(dof,))[dof]
    return wave[:, AXES.index(dof)], angle[n:]


def reference_loop(torque_nm, gain):
    """Angles (at zero torque falling, at zero rising, at the peak) of springs and iron alone, by solve_ivp.

    Quasi-static balance k θ = u + k_c M(θ) + p(θ) - p6, differentiated along the path: dθ (k - k_c dM/dθ - p') = du.
    """
    ja, poly = effect("jiles-atherton", "theta_x"), effect("magnetic-polynomial", "theta_x")
    modes = {m.label: m for m in load_model("as-built").modes if m.label.startswith("theta_x")}
    static = sum(number(m.input["torque_x"]) / (2 * np.pi * number(m.frequency_hz)) ** 2 for m in modes.values())
    stiffness = 1.0 / (static * gain)
    p = [poly[f"p{i}"] for i in range(1, 6)] + [0.0]

    def slopes(state, sign):
        theta, m = state
        x = (theta + ja["alpha"] * m) / ja["a"]
        man = ja["ms"] * (x / 3 - x**3 / 45) if abs(x) < 1e-3 else ja["ms"] * (1 / np.tanh(x) - 1 / x)
        dman = ja["ms"] / ja["a"] * (1 / 3 - x**2 / 15 + 2 * x**4 / 189)
        gap = man - m
        irreversible = gap / ((1 + ja["c"]) * (sign * ja["pinning"] - ja["alpha"] * gap)) if sign * gap > 0 else 0.0
        reversible = ja["c"] / (1 + ja["c"]) * dman
        dm = (irreversible + reversible) / (1 - ja["alpha"] * reversible)
        dtheta = 1.0 / (stiffness - ja["size"] * dm - np.polyval(np.polyder(p), theta))
        return np.array([dtheta, dtheta * dm])

    state, seen = np.zeros(2), []
    for start, end in itertools.pairwise([0, 1, 0, -1, 0, 1, 0, -1, 0]):
        sign = np.sign(end - start)
        state = solve_ivp(
            lambda _, y, sign=sign: sign * torque_nm * slopes(y, sign), (0, 1), state, rtol=1e-9, atol=1e-15
        ).y[:, -1]
        seen.append(state[0])
    return seen[5], seen[7], seen[4]


# what the caption of Fig. 6.7 and Table 6.7's chops span: 4.5, 7.2 and 8.5 mrad
@pytest.mark.parametrize("torque_nm", [0.05, 0.08, 0.095])
def test_remanence_is_that_of_the_jiles_atherton_equations(torque_nm):
    _, angle = loop("theta_x", torque_nm)
    n = angle.size
    rising, falling, peak = angle[0], angle[n // 2], angle[n // 4]
    gain = 1.005  # true angle per reading
    expected_falling, expected_rising, expected_peak = reference_loop(torque_nm, gain)
    # viscous lag of 2 sigma / omega0² x 2 pi 0.05 Hz = 9e-5 of the amplitude; the kernel's own error is below that
    np.testing.assert_allclose(
        gain * np.array([falling, rising, peak]), [expected_falling, expected_rising, expected_peak], atol=2e-4 * peak
    )
    remanence = 0.5 * (falling - rising) / peak
    expected = 0.5 * (expected_falling - expected_rising) / expected_peak
    # the same 9e-5 of lag widens the loop at zero torque; docs/bench-model.md sets it beside the paper's
    # "approx. 0.7 %". The printed k/µ0 would leave none at all.
    assert remanence == pytest.approx(expected, abs=1.5e-4)
    assert expected > 5e-3


def test_identified_stiffness_at_one_milliradian_is_the_printed_one():
    for dof, plant in (("theta_x", paper_plants.theta_x()), ("theta_y", paper_plants.theta_y())):
        static = plant.frequency_response(np.array([0.0]))[0, 0, 0].real
        _, angle = loop(dof, 1e-3 / static)
        n = angle.size
        # calibrated where the true angle swings 1 mrad; the readings' 0.5 % move that by 3e-5 of the stiffness, the
        # file's five digits of frequency by 3e-6 (twice), the modes left out of the compensation by 7e-6
        assert 0.5 * (angle[n // 4] - angle[3 * n // 4]) == pytest.approx(1e-3, rel=1e-4)


# drives


def test_hybrid_chop_peaks_at_the_calibrated_current_and_stays_within_the_power_requirement():
    bench = SimBench(as_built(*NOISES), 0)
    segment = chop_segment(0.0, 5.0, 10)
    channels = bench.play(segment).channels
    current = np.stack([channels[f"current_a{i}"] for i in (1, 2, 3)])
    # four digits of radius in the file; the feedback adds what the iron asks for, a few mA
    assert np.max(np.abs(current)) == pytest.approx(2.75, rel=5e-3)
    power_w = np.mean(np.sum((current * 5.7 / 7.9) ** 2, axis=0))
    assert power_w < 1.0


def test_amplifiers_give_no_more_than_nine_amperes():
    wave = np.zeros((1, 3))
    wave[0, 2] = 200.0  # 11.7 A in each
    channels = play(SimBench(as_built(*NOISES), 0), 3, feedforward=wave)
    np.testing.assert_allclose(channels["current_a1"], 9.0, rtol=1e-12)


def test_temperature_follows_the_power_of_the_currents():
    bench = SimBench(as_built(*NOISES), 0)
    hw = load_model("as-built").hardware
    assert hw is not None
    force = 2.0
    wave = np.array([[0.0, 0.0, 3 * force]]) * 0.1
    n = 100_000
    measured = play(bench, n, feedforward=wave, record=("temperature",))["temperature"]
    power_w = 3 * (0.1 * force / 7.9) ** 2
    t = np.arange(n) / RATE_HZ
    expected = 77.0 + number(hw.thermal_resistance_k_w) * power_w * -np.expm1(-t / number(hw.thermal_time_constant_s))
    # explicit Euler: half a step of dt/tau = 8e-7 of the rise
    np.testing.assert_allclose(measured, expected, atol=1e-9)


def test_cold_finger_is_settled_when_its_segment_begins():
    bench = SimBench(as_built(), 0)
    cold = play(bench, 10, cold_finger_k=63.5, record=("temperature",))["temperature"]
    np.testing.assert_allclose(cold, 63.5, atol=1e-9)


# sensors


def axis_model(axis):
    whole = load_model("design-4th-order").linear()
    acts = whole.b[:, axis] != 0.0
    return whole.with_(
        omega_rad_s=whole.omega_rad_s[acts],
        sigma_1_s=whole.sigma_1_s[acts],
        b=whole.b[acts][:, [axis]],
        b_direct=whole.b_direct[acts][:, [axis]],
        c=whole.c[[axis]][:, acts],
        c_rate=whole.c_rate[[axis]][:, acts],
        d=whole.d[[axis]][:, [axis]],
        delay_s=whole.delay_s[[axis]],
    )


def chop_segment(alpha_deg, rate_hz, cycles, record=()):
    n = int(RATE_HZ / rate_hz)
    reference, feedforward, gates = np.zeros((n, 3)), np.zeros((n, 3)), [Gate(0, 2, True)]
    for axis, part in enumerate((np.cos(np.deg2rad(alpha_deg)), np.sin(np.deg2rad(alpha_deg)))):
        chop = Chop((8.5e-3 * part, 0.0), n // 2, RATE_HZ)
        program = hybrid(chop, least_norm(axis_model(axis), 1.0, 50, RATE_HZ), axis)
        reference[:, axis], feedforward[:, axis] = program.reference, program.feedforward
        gates += program.gates
    loops = (theta_controller(), theta_controller(), z_controller())
    return Segment("chop", cycles * n, reference, feedforward, feedback=loops, gates=tuple(gates), record=record)


@pytest.mark.parametrize("alpha_deg", [0.0, 120.0])
def test_hybrid_chop_is_as_stable_as_the_closed_form_says(alpha_deg):
    channels = SimBench(as_built(), 11).play(chop_segment(alpha_deg, 0.5, 16, record=AXES)).channels
    worst = 0.0
    for dof in AXES:
        cycles = channels[dof].reshape(-1, 20_000)[1:]
        for window in (cycles[:, 5000:10_000], cycles[:, 15_000:]):
            worst = max(worst, 3.0 * np.std(window - window.mean()))
    # 15 windows of 0.5 s give each 3 sigma with a scatter of 2.7 % (campaigns.calibration); 2.09 µrad is expected of
    # the largest of 24, 1.95 scatters above the true value. The largest of four lies 1.03 of them above it, and 2.5 are
    # left on either side.
    true_rad = 2.09e-6 / (1.0 + 1.95 * 0.027)
    assert worst == pytest.approx(true_rad * 1.027, rel=2.5 * 0.027)


def test_every_head_is_below_30_nm_in_eight_end_stop_positions():
    bench = SimBench(as_built(), 4)
    to_command = np.linalg.inv(bench.limits.to_current)
    heads = ("head_s1", "head_s2", "head_s3")
    for signs in itertools.product((1.0, -1.0), repeat=3):
        pull = (to_command @ (6.0 * np.array(signs)))[None, :]
        n = 10_000
        ramp = (0.5 - 0.5 * np.cos(np.pi * np.arange(n) / n))[:, None] * pull
        bench = SimBench(as_built(), 4)
        play(bench, n, feedforward=ramp)
        play(bench, n, feedforward=pull)
        channels = play(bench, n, feedforward=pull, record=heads)
        for head in heads:
            sigma = np.std(channels[head])
            assert 3.0 * sigma < 30e-9, (signs, head)
            # beyond the gap at the actuators, and never quieter than the head itself
            assert sigma > 4e-9
            assert abs(channels[head].mean()) > 0.2735e-3


@pytest.mark.parametrize("signs", [(1, 1, 1), (1, 1, -1), (1, -1, -1)])
def test_slamming_into_the_stops_with_all_the_current_stays_bounded(signs):
    bench = SimBench(as_built(), 1, truth=True)
    blow = np.linalg.inv(bench.limits.to_current) @ (9.0 * np.array(signs))
    n = 20_000
    wave = np.where((np.arange(n) // 300 % 2)[:, None] > 0, blow, -blow)
    channels = play(bench, n, feedforward=wave)
    # energy: what three forces F do over the way from one side to the other, and what three stops had stored, all put
    # into one stop of stiffness k: k/2 d² = 3 F (gap + F/k + gap + d) + 3/2 F²/k for its depth d. Losses only lower it.
    gap, stiffness, force = 0.2735e-3, 4e5, 9.0 * 5.7
    sag = force / stiffness
    depth = 3 * sag + np.sqrt(9 * sag**2 + 6 * sag * (2 * gap + sag) + 3 * sag**2)
    # by (6.1) an angle is at most 4/3 of a height over the radius
    tilt = 4 / 3 * (gap + depth) / 0.02735
    for dof, reach in (("theta_x", tilt), ("theta_y", tilt), ("z", gap + depth)):
        assert np.max(np.abs(channels[f"true_{dof}"])) < reach, dof


def test_head_noise_is_floor_and_apex_together():
    rest = play(SimBench(as_built("amplifier-noise"), 1), 50_000, record=("head_s1",))["head_s1"]
    # 50,000 samples: 0.3 % of standard deviation, four of them
    assert np.std(rest) == pytest.approx(4e-9, rel=0.013)
    bench = SimBench(as_built("amplifier-noise"), 1)
    lift = np.array([[0.0, 0.0, 0.2e-3 / 0.6352e-3]])
    play(bench, 30_000, feedforward=lift)
    held = play(bench, 50_000, feedforward=lift, record=("head_s1",))["head_s1"]
    displacement = held.mean()
    assert displacement == pytest.approx(0.2e-3, rel=1e-3)
    assert np.std(held) == pytest.approx(np.hypot(4e-9, 1.0e-5 * displacement), rel=0.013)


def test_theodolite_sees_the_true_angle_and_only_when_asked():
    bench = SimBench(as_built(), 2)
    assert not any(name.startswith("theodolite") for name in play(bench, 2))
    names = (*AXES, "theodolite_theta_x", "theodolite_theta_y")
    readings = []
    for torque in np.linspace(-0.08, 0.08, 5):
        held = np.array([[torque, -torque, 0.0]])
        play(bench, 20_000, feedforward=held)
        channels = play(bench, 5_000, feedforward=held, record=names)
        readings.append([channels[n].mean() for n in names])
    sensor_x, sensor_y, seen_x, seen_y = np.array(readings).T
    # theodolite: 2.5 µrad / sqrt(5000) = 0.04 µrad per point over 14 mrad: 3e-6 of the gain; sensors less
    assert np.polyfit(sensor_x, seen_x, 1)[0] == pytest.approx(1.005, abs=2e-5)
    assert np.polyfit(sensor_y, seen_y, 1)[0] == pytest.approx(1.004, abs=2e-5)


def test_end_stops_of_the_limits_are_those_of_the_contact():
    limits = SimBench(as_built(), 0).limits
    hw = load_model("as-built").hardware
    assert hw is not None
    gap, radius = effect("end-stop-contact", "a1")["gap"], number(hw.actuators.radius_m)
    np.testing.assert_allclose(limits.reference, [gap / radius, gap / radius, gap], rtol=1e-12)


# safe, learning


def learning_of(axis):
    plant = axis_model(axis)
    tuning = TABLE_6_5[AXES[axis]]
    static = float(plant.frequency_response(np.array([0.0]))[0, 0, 0].real)
    filt = learning_filter(plant.omega_rad_s[:1], plant.sigma_1_s[:1], static, tuning.cutoff_hz, RATE_HZ)
    return Learning(filt, tuning.gain, tuning.lead_samples, 2000)


def test_safe_zeroes_the_drives_whatever_was_closed_and_learned():
    bench = SimBench(as_built(), 0)
    reference = np.zeros((2000, 3))
    reference[1000:, 0] = 1e-3
    loops, learn = (theta_controller(), None, None), (learning_of(0), None, None)
    play(bench, 4000, reference=reference, feedback=loops, gates=(Gate(0, 0, True),), learning=learn)
    bench.safe()
    repeat = (replace(learn[0], active=False), None, None)
    channels = play(bench, 4000, feedback=loops, learning=repeat)
    assert not np.any(channels["command_theta_x"])


@pytest.mark.parametrize(("axis", "periods"), [(0, 20), (1, 8)])
def test_learning_takes_as_many_periods_as_its_gain_says(axis, periods):
    # at rest the error shrinks by 1 - k_r P L = 1 - k_r from one period to the next. The iron changes P by up to 2 %,
    # which is n k_r (1 - k_r)^(n-1) 2 % < 0.01 of the level; as much again for what still rings in the mean of a dwell
    bench = SimBench(as_built(*NOISES), 0)
    limits = MotionLimits(1e3, 1e6, 1e9, 8.2e9)  # a move of 4.8 ms, as smooth as that time allows
    reference = np.zeros((2000, 3))
    reference[:, axis] = Chop((8.5e-3, 0.0), 1000, RATE_HZ).profile(limits)
    learn = tuple(learning_of(axis) if i == axis else None for i in range(3))
    reading = play(bench, 2000 * (periods + 1), reference=reference, learning=learn)[AXES[axis]]
    level = reading.reshape(-1, 2000)[:, :1000].mean(axis=1)
    left = 1.0 - level / np.mean(reference[:1000, axis])
    gain = TABLE_6_5[AXES[axis]].gain
    expected = (1.0 - gain) ** np.arange(periods + 1)
    np.testing.assert_allclose(left, expected, atol=0.02)
