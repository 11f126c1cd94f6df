"""Every calibrated number of the as-built bench comes back from its target, and from a second way of computing it."""

from functools import cache

import msgspec
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import erf

from analysis.paper.numbers import paper_tables
from campaigns.calibration import (
    INSIDE_PERCENT,
    calibrations,
    disturbance_levels,
    largest_normal,
    magnetic_stiffness_nm_rad,
    main,
    scatter_of_sigma,
    share_inside,
    stability_rad,
)
from campaigns.playing.campaign import load_campaign
from sim_backend.along import torque_along
from sim_backend.bench import Gate, Segment
from sim_backend.control.feedback import theta_controller
from sim_backend.model import EffectEntry, load_model, number
from sim_backend.simbench import SimBench

BENCH, DESIGN, FEEDFORWARD = (load_model(n) for n in ("as-built", "design", "design-4th-order"))
PARAMETERS = (
    "actuator radius",
    "amplifier noise",
    "theta_x suspension without iron",
    "theta_y suspension without iron",
)


@cache
def rows():
    """All calibrations by their parameter; not when the tests are collected, which every worker does."""
    return {row.parameter: row for row in calibrations(BENCH, DESIGN, FEEDFORWARD)}


def digits(value):
    """Half a unit of the last digit with which the file writes the value, as part of it."""
    mantissa = repr(value).replace(".", "").lstrip("0").split("e")[0]
    return 0.5 / float(mantissa) * 1.0000001


@pytest.mark.parametrize("parameter", PARAMETERS)
def test_model_holds_what_its_target_asks_for(parameter):
    row = rows()[parameter]
    # the noise has three digits, and one unit is left for the radius having been rounded before it
    margin = 2.0 if row.unit == "A" else 1.0
    assert row.in_model == pytest.approx(row.computed, rel=margin * digits(row.in_model))


def test_these_are_all_parameters_with_a_target():
    assert tuple(rows()) == PARAMETERS


def test_calibrated_parameters_are_exactly_those_that_the_file_calls_so():
    builtins = msgspec.to_builtins(BENCH)

    def count(node):
        if isinstance(node, dict):
            return (node.get("origin") == "calibrated") + sum(count(v) for v in node.values())
        return sum(count(v) for v in node) if isinstance(node, list) else 0

    # one radius, two suspensions, and the same noise at three amplifiers
    assert count(builtins) == 1 + 2 + 3
    assert len({number(e.parameters["std"]) for e in BENCH.effects if e.effect == "amplifier-noise"}) == 1


def test_magnetic_softening_against_an_independent_integration():
    # explicit Euler of (6.4) in plain numpy, 200,000 steps per cycle: first-order error 1e-5 of the slope
    k_c, a, pinning, c, alpha, ms = 0.99, 0.44, 1750.70 * 4e-7 * np.pi, 0.22, 1e-3, 0.44
    poly = np.array([7.289990e-9, 2.101289e-9, -2.663815e-6, 8.192315e-6, 1.059444e-4, 1.608167e-3])
    swing, n = 1e-3, 20_000
    field = swing * np.sin(2 * np.pi * np.arange(3 * n + 1) / n)
    m, seen = 0.0, {}
    for k, (h, dh) in enumerate(zip(field[:-1], np.diff(field), strict=True)):
        seen[k] = m
        x = (h + alpha * m) / a
        man, dman = ms * (x / 3 - x**3 / 45), ms / a * (1 / 3 - x**2 / 15)
        sign, gap = np.sign(dh), man - m
        irreversible = gap / ((1 + c) * (sign * pinning - alpha * gap)) if sign * gap > 0 else 0.0
        m += (irreversible + c / (1 + c) * dman) / (1 - alpha * c / (1 + c) * dman) * dh
    top, bottom = 2 * n + n // 4, 2 * n + 3 * n // 4
    iron = k_c * (seen[top] - seen[bottom]) / (2 * swing)
    magnet = (np.polyval(poly, 1e3 * swing) - np.polyval(poly, -1e3 * swing)) / (2 * swing)
    assert magnetic_stiffness_nm_rad(BENCH, "theta_x", swing) == pytest.approx(iron + magnet, rel=1e-3)


def test_torque_along_a_path_is_the_effects_own():
    angle = np.linspace(-1e-2, 1e-2, 50)
    spring = EffectEntry(effect="cubic-stiffness", where="anywhere", parameters={"stiffness": 3.0})
    np.testing.assert_allclose(torque_along(spring, angle), -3.0 * angle**3, rtol=1e-14)


def test_closed_form_stability_is_what_a_loop_measures():
    # on the linear design model with the bench's hardware and noises, held at zero: only the closed form's own terms
    noises = [e for e in BENCH.effects if e.effect in ("amplifier-noise", "sensor-noise", "apex-noise")]
    model = msgspec.structs.replace(DESIGN, hardware=BENCH.hardware, effects=noises)
    n = 400_000
    rest = np.zeros((1, 3))
    loops = (theta_controller(), theta_controller(), None)
    bench = SimBench(model, 8)
    gates = (Gate(0, 0, True), Gate(0, 1, True))
    bench.play(Segment("settle", 20_000, rest, rest, feedback=loops, gates=gates))
    channels = bench.play(Segment("hold", n, rest, rest, feedback=loops, gates=gates)).channels
    measured = 3.0 * max(np.std(channels[d]) for d in ("theta_x", "theta_y"))
    # apex noise at 8.5 mrad, which the closed form includes, adds at most 0.5 %; 40 s of noise within 100 Hz are 8000
    # samples: 0.8 % of standard deviation, four of them
    assert measured == pytest.approx(stability_rad(BENCH, DESIGN, rows()["amplifier noise"].in_model), rel=0.035)


def test_largest_of_normal_numbers_is_what_is_tabulated():
    # closed forms for 2 and 3; 25: Harter, Biometrika 48 (1961), to its five decimals
    assert largest_normal(2) == pytest.approx(1.0 / np.sqrt(np.pi), abs=1e-9)
    assert largest_normal(3) == pytest.approx(1.5 / np.sqrt(np.pi), abs=1e-9)
    assert largest_normal(25) == pytest.approx(1.96531, abs=5e-6)


def test_scatter_of_sigma_of_first_order_noise():
    # behind a first-order low pass at fc the integral is 1/(4 pi fc T) of the variance of σ over σ², by hand; the band
    # ends at 1000 fc, which leaves out 2/pi/1000 of the power
    corner_hz, step_hz = 5.0, 0.01
    f = np.arange(0.5 * step_hz, 1000.0 * corner_hz, step_hz)
    scatter = scatter_of_sigma(1.0 / (1.0 + (f / corner_hz) ** 2), step_hz, 7.5)
    assert scatter == pytest.approx(np.sqrt(1.0 / (4.0 * np.pi * corner_hz * 7.5)), rel=1e-3)


def test_share_inside_a_circle():
    # equal angles: Rayleigh's closed form
    assert share_inside(0.6, 0.6, 1.7) == pytest.approx(1.0 - np.exp(-0.5 * (1.7 / 0.6) ** 2), rel=1e-12)
    # unequal ones: one angle in closed form, the other by quadrature
    strip, _ = quad(lambda x: np.exp(-0.5 * x**2) * erf(np.sqrt((1.7**2 - x**2) / 2.0) / 0.4), -1.7, 1.7, epsabs=1e-12)
    assert share_inside(1.0, 0.4, 1.7) == pytest.approx(strip / np.sqrt(2.0 * np.pi), rel=1e-7)
    draws = np.random.default_rng(2).normal(size=(2, 400_000)) * [[0.9], [0.5]]
    # a share of 93 % of 400,000 is known to 0.04 %, four times that
    assert share_inside(0.9, 0.5, 1.7) == pytest.approx(np.mean(np.hypot(*draws) < 1.7), abs=1.6e-3)


def test_levels_of_the_campaign_are_those_that_table_6_7_asks_for():
    levels = load_campaign("paper").levels()
    asked = disturbance_levels(BENCH, DESIGN)
    assert {name: levels[name] for name in asked} == {name: round(level, 3) for name, level in asked.items()}
    assert {name for name, level in levels.items() if level != 1.0} == set(asked)


def test_the_percentages_are_those_of_position_1():
    forms = {"0:+8.5": "up", "0:-8.5": "down", "-8.5:+8.5": "wide"}
    printed = paper_tables()["6.7"]
    assert INSIDE_PERCENT == {
        f"chop-{alpha}-{name}": pytest.approx(100.0 * printed.value(f"{alpha} {form} 1"), abs=1e-9)
        for alpha in (0, 120, 240)
        for form, name in forms.items()
    }


def test_command_prints_every_target(capsys):
    main()
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) == len(rows()) + len(INSIDE_PERCENT)
    assert all(row.target in line for row, line in zip(rows().values(), printed, strict=False))
