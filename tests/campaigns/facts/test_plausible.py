"""Units are checked against what a bench can be: by the span, where something is driven, and among outputs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from campaigns.facts import Fact, Seen, found_in
from campaigns.facts.plausible import NAME, SPANS
from campaigns.log import Channel, LogSegment
from campaigns.log.units import UNITS
from campaigns.plans import make_plan
from campaigns.playing.recording import play_in_memory
from sim_backend.model import load_model
from sim_backend.simbench import SimBench
from tests.small_bench import NOISE, bench_model

RATE_HZ = 1000.0
ROWS = 4000
DEG = math.pi / 180.0
URAD = 1e-6


def wave(seed: int = 0) -> np.ndarray:
    """Return noise that spans exactly 2, from -1 to 1."""
    values = np.random.default_rng(seed).standard_normal(ROWS)
    return 2.0 * (values - values.min()) / np.ptp(values) - 1.0


def record(channels: Mapping[str, tuple[str, str, str, np.ndarray]]) -> Seen:
    """Return channels of (role, unit, dof, values) as one segment."""
    described = {name: Channel(name, unit, role, dof, RATE_HZ) for name, (role, unit, dof, _) in channels.items()}
    columns = {name: values for name, (*_, values) in channels.items()}
    return Seen(columns, described, [LogSegment("record", 0, ROWS, {})], RATE_HZ)


def doubted(seen: Seen) -> dict[str, Fact]:
    return {fact.channel: fact for fact in found_in(seen, ()) if fact.name in ("size", NAME) and fact.remark}


def mirror(angle: np.ndarray, torque: np.ndarray | None = None) -> Seen:
    torque = 0.05 * wave(1) if torque is None else torque
    return record({"torque": ("input", "N m", "x", torque), "angle": ("output", "rad", "x", angle)})


@pytest.mark.parametrize("stroke_urad", [100.0, 500.0, 5000.0])
def test_microradians_that_were_read_as_degrees(stroke_urad: float) -> None:
    assert doubted(mirror(stroke_urad * URAD * wave())) == {}
    (fact,) = doubted(mirror(stroke_urad * DEG * wave())).values()
    assert fact.channel == "angle" and "too large, degrees for microradians" in fact.means


@pytest.mark.parametrize("stroke_deg", [0.01, 0.1, 0.45])
def test_degrees_that_were_read_as_microradians(stroke_deg: float) -> None:
    assert doubted(mirror(stroke_deg * DEG * wave())) == {}
    (fact,) = doubted(mirror(stroke_deg * URAD * wave())).values()
    assert fact.channel == "angle" and "too small, microradians for degrees" in fact.means


@pytest.mark.parametrize("unit", SPANS)
@pytest.mark.parametrize("role", ["input", "output"])
def test_each_unit_is_doubted_beyond_its_limits_and_not_within(unit: str, role: str) -> None:
    limits = SPANS[unit]
    assert UNITS[unit].si == unit and 0.0 <= limits.least < limits.most
    for span, wrong in (
        (1.01 * limits.most, True),
        (0.99 * limits.most, False),
        (1.01 * limits.least, False),
        (0.99 * limits.least, limits.least > 0.0),
    ):
        other = "output" if role == "input" else "input"
        seen = record({"a": (role, unit, "x", 0.5 * span * wave()), "b": (other, "1", "y", wave(1))})
        assert list(doubted(seen)) == (["a"] if wrong and span > 0.0 else []), (span, limits)


def test_noise_at_rest_is_not_doubted() -> None:
    """Nothing is driven: by an input that stands still, or in a loop whose reference does."""
    quiet = 5e-9 * wave()
    assert doubted(mirror(quiet, np.full(ROWS, 0.02))) == {}
    held = {
        "reference": ("reference", "rad", "x", np.full(ROWS, 1e-3)),
        "torque": ("input", "N m", "x", 1e-5 * wave(1)),
        "angle": ("output", "rad", "x", quiet),
    }
    assert doubted(record(held)) == {}


@pytest.mark.parametrize("other", ["no input", "rests", "held by a loop"])
def test_an_axis_beside_the_one_that_is_driven_shows_its_noise_only(other: str) -> None:
    """Of 10 mrad and 20 nrad, a ratio of 5·10⁵, nothing is said: the other axis is not driven, or hardly."""
    channels = {
        "torque_x": ("input", "N m", "x", 0.05 * wave(1)),
        "theta_x": ("output", "rad", "x", 5e-3 * wave(2)),
        "theta_y": ("output", "rad", "y", 1e-8 * wave(3)),
    }
    if other != "held by a loop":
        channels["z"] = ("output", "m", "z", 1e-11 * wave(4))
    if other != "no input":
        channels["torque_y"] = ("input", "N m", "y", (0.0 if other == "rests" else 2e-6) * wave(5))
        channels["force_z"] = ("input", "N", "z", np.zeros(ROWS))
    assert doubted(record(channels)) == {}


def two_axes(x_rad: np.ndarray, y_rad: np.ndarray) -> Seen:
    return record(
        {
            "torque_x": ("input", "N m", "x", 0.05 * wave(1)),
            "torque_y": ("input", "N m", "y", 0.03 * wave(2)),
            "theta_x": ("output", "rad", "x", x_rad),
            "theta_y": ("output", "rad", "y", y_rad),
        }
    )


def test_two_axes_of_which_one_is_in_another_unit() -> None:
    """30 µrad, of which one axis is read as degrees: 1 rad in all, which is no angle that is doubted by itself."""
    motion = 15.0 * URAD * wave(3), 15.0 * URAD * wave(4)
    assert doubted(two_axes(*motion)) == {}
    (fact,) = doubted(two_axes(motion[0], motion[1] / URAD * DEG)).values()
    assert fact.name == NAME and fact.numbers["ratio"] == pytest.approx(URAD / DEG, rel=0.1)
    assert "theta_x has" in fact.finding and "times the rms of theta_y, both in rad" in fact.finding


def test_of_several_sensors_of_one_axis_the_odd_one_is_told() -> None:
    motion = 1e-4 * wave(3)
    outputs = {f"s{k}": ("output", "m", "z", motion * (1.0 if k != 2 else 1e-6)) for k in range(4)}
    outputs["current"] = ("output", "A", "z", 1e3 * motion)
    assert list(doubted(record({"force": ("input", "N", "z", wave(1)), **outputs}))) == ["s2"]


@pytest.mark.parametrize("value", [0.0, 0.1, 1e-3 / 3.0])
def test_a_dead_output_is_no_odd_one(value: float) -> None:
    found = found_in(two_axes(1e-3 * wave(3), np.full(ROWS, value)), ())
    assert [fact.name for fact in found if fact.remark] == ["dead"]


def test_channels_that_belong_to_no_axis_are_compared_as_they_are() -> None:
    """An import need not say which input drives what."""
    channels = {
        "u": ("input", "V", "", wave(1)),
        "y1": ("output", "rad", "", 1e-5 * wave(2)),
        "y2": ("output", "rad", "", 1.2e-5 / URAD * DEG * wave(3)),
    }
    assert list(doubted(record(channels))) == ["y1"]


MULTISINE = {"axes": ("theta_x",), "realisations": 1, "period_s": 0.5, "start_hz": 2.0, "stop_hz": 500.0}
SWEEP = {
    "axis": "theta_x",
    "bands": [{"start_hz": 20.0, "stop_hz": 40.0, "step_hz": 5.0, "settle_s": 0.3, "measure_s": 0.2}],
}


@pytest.mark.parametrize("model", ["as-built", "5 nm of noise and nothing else"])
@pytest.mark.parametrize(
    ("plan", "settings"),
    [("rest", {}), ("multisine", MULTISINE), ("sinesweep", SWEEP), ("settling", {"cycles": 1})],
    ids=["rest", "multisine", "sinesweep", "settling"],
)
def test_the_bundled_bench_gets_no_false_remark(model: str, plan: str, settings: dict[str, Any]) -> None:
    """Milliradians on one axis, nanometres of noise on the others: in the open and in a loop."""
    bench = SimBench(load_model(model) if model == "as-built" else bench_model(NOISE), 3)
    played = play_in_memory(make_plan(plan, settings), bench)
    columns = {name: played.read(name) for name in played.channels}
    assert doubted(Seen(columns, played.channels, played.segments, played.sample_rate_hz)) == {}
