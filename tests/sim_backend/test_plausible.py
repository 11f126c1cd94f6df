"""Absurd numbers of a model are refused by name, or end the simulation in one clear line; never a NaN in a record."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np
import pytest
import tomli_w

from sim_backend.bench import Segment
from sim_backend.errors import ConfigError
from sim_backend.model import EffectEntry, Quantity, bundled_models, dump_model, load_model, number, parse_model
from sim_backend.simbench import SimBench
from tests.small_bench import NOISE, bench_model

ABSURD = (0.0, -1.0, 1e-300, 1e300, -1e300, 1.7e308, 2.0**70, 1e9, float("inf"), float("nan"))
ZERO_IS_ABSURD = {"radius_m", "force_constant_n_a", "actuator_steepness_n_sqrt_w", "thermal_time_constant_s"}


def places(node: Any, place: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Yield the way to every number of a TOML document."""
    if isinstance(node, dict | list):
        for key, value in node.items() if isinstance(node, dict) else enumerate(node):
            yield from places(value, (*place, key))
    elif isinstance(node, float | int):
        yield place


def changed(document: dict[str, Any], place: tuple[str | int, ...], value: float) -> str:
    copy: Any = tomllib.loads(tomli_w.dumps(document))
    node = copy
    for key in place[:-1]:
        node = node[key]
    node[place[-1]] = value
    return tomli_w.dumps(copy)


def play(text: str) -> None:
    """Play a short segment; every channel must hold finite numbers."""
    bench = SimBench(parse_model(text, "m.toml"), 1)
    wave = np.zeros((50, len(bench.axes)))
    wave[:, 0] = 1e-5
    record = bench.play(Segment("a", 100, np.zeros_like(wave), wave))
    assert all(np.all(np.isfinite(values)) for values in record.channels.values())


SMALL = tomllib.loads(dump_model(bench_model(NOISE)))


@pytest.mark.filterwarnings("ignore:.*encountered in:RuntimeWarning")  # on the way to what is then refused
@pytest.mark.parametrize("place", list(places(SMALL)), ids=lambda place: ".".join(map(str, place)))
def test_any_number_may_be_absurd(place: tuple[str | int, ...]) -> None:
    refused = set()
    for value in ABSURD:
        try:
            play(changed(SMALL, place, value))
        except ConfigError as error:
            refused.add(str(value))
            assert str(error).startswith(("m.toml: ", "segment 'a': ", "effect ")) and "\n" not in str(error)
    assert {"1e+300", "1.7e+308", "inf", "nan"} <= refused
    if place[-1] in ZERO_IS_ABSURD:
        assert {"0.0", "1e-300"} <= refused


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("radius_m = 0.03", "radius_m = 0.0", "hardware.actuators.radius_m is 0; it must be at least 1e-12"),
        ("peak_current_a = 9.0", "peak_current_a = -9.0", "hardware.peak_current_a is -9; it must be at least 1e-12"),
        ("sample_rate_hz = 10000.0", "sample_rate_hz = 1e-300", "sample_rate_hz is 1e-300; it must be at least 1e-06"),
        ("decay_rate_1_s = 4.7", "decay_rate_1_s = 1e19", "modes.0.decay_rate_1_s is 1e+19; every number must be"),
        ("decay_rate_1_s = 4.7", "decay_rate_1_s = nan", "modes.0.decay_rate_1_s is nan; every number must be finite"),
    ],
)
def test_the_message_names_the_number_its_value_and_the_limit(old: str, new: str, said: str) -> None:
    text = dump_model(bench_model(NOISE))
    assert old in text
    with pytest.raises(ConfigError) as caught:
        parse_model(text.replace(old, new, 1), "m.toml")
    assert str(caught.value).startswith(f"m.toml: {said}")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        # 5.7 N/A times 9 A are 51.3 N
        (
            {"continuous_force_n": 51.4},
            "is 51.4 N, but a peak current of 9 A gives 51.3 N with 5.7 N/A; state at most 51.3",
        ),
        (
            {"peak_current_a": 1.5},
            "is 9 N, but a peak current of 1.5 A gives 8.55 N .* peak current of 1.57895 A or more",
        ),
        ({"force_constant_n_a": 0.9}, "is 9 N, but a peak current of 9 A gives 8.1 N with 0.9 N/A"),
        (
            {"peak_current_a": Quantity(value=1.5, origin="printed", source="a book")},
            "is 9 N, but a peak current of 1.5 A",
        ),
    ],
)
def test_limits_of_the_hardware_that_contradict_each_other_are_refused(changes: dict[str, Any], said: str) -> None:
    model = bench_model(NOISE)
    assert model.hardware is not None
    wrong = msgspec.structs.replace(model, hardware=msgspec.structs.replace(model.hardware, **changes))
    with pytest.raises(ConfigError, match=f"m.toml: hardware.continuous_force_n {said}"):
        parse_model(dump_model(wrong), "m.toml")


@pytest.mark.parametrize("changes", [{"continuous_force_n": 51.3}, {"peak_current_a": 9.0 / 5.7}])
def test_a_continuous_force_may_be_all_that_the_peak_current_gives(changes: dict[str, float]) -> None:
    model = bench_model(NOISE)
    assert model.hardware is not None
    at_most = msgspec.structs.replace(model, hardware=msgspec.structs.replace(model.hardware, **changes))
    assert parse_model(dump_model(at_most), "m.toml") == at_most


def test_what_a_diagnosis_finds_may_contradict_the_hardware() -> None:
    found = (
        EffectEntry(effect="amplifier-saturation", where="A1", parameters={"limit": 5.0}),
        EffectEntry(effect="end-stop-contact", where="A2", parameters={"gap": 1e-4, "stiffness": 4e5}),
    )
    model = bench_model(found)
    assert parse_model(dump_model(model), "m.toml") == model


def test_the_bench_as_built_is_at_one_with_its_hardware() -> None:
    model = load_model("as-built")
    assert model.hardware is not None
    hardware, radius_m = model.hardware, number(model.hardware.actuators.radius_m)
    limits = {number(e.parameters["limit"]) for e in model.effects if e.effect == "amplifier-saturation"}
    gaps = {number(e.parameters["gap"]) for e in model.effects if e.effect == "end-stop-contact"}
    assert limits == {number(hardware.peak_current_a)}
    assert gaps == {number(hardware.end_stop_z_m)}
    # the file has four digits of the gap
    assert number(hardware.end_stop_z_m) == pytest.approx(radius_m * number(hardware.end_stop_angle_rad), rel=5e-5)


def test_a_simulation_that_diverges_says_where() -> None:
    text = dump_model(bench_model(NOISE)).replace("decay_rate_1_s = 4.7", "decay_rate_1_s = -1e6", 1)
    unstable = r"segment 'a': \w+ of the simulated bench is not a finite number at sample \d+"
    with pytest.raises(ConfigError, match=unstable):
        play(text)


@pytest.mark.parametrize("name", bundled_models())
def test_models_of_real_benches_are_not_refused(name: str) -> None:
    load_model(name)
