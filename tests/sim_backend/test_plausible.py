"""Absurd numbers of a model are refused by name, or end the simulation in one clear line; never a NaN in a record."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import tomli_w

from sim_backend.bench import Segment
from sim_backend.errors import ConfigError
from sim_backend.model import bundled_models, dump_model, load_model, parse_model
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


def test_a_simulation_that_diverges_says_where() -> None:
    text = dump_model(bench_model(NOISE)).replace("decay_rate_1_s = 4.7", "decay_rate_1_s = -1e6", 1)
    unstable = r"segment 'a': \w+ of the simulated bench is not a finite number at sample \d+"
    with pytest.raises(ConfigError, match=unstable):
        play(text)


@pytest.mark.parametrize("name", bundled_models())
def test_models_of_real_benches_are_not_refused(name: str) -> None:
    load_model(name)
