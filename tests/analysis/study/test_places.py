"""Places in a model are found as the file is written, and nothing else is changed."""

from __future__ import annotations

import copy
from typing import Any

import msgspec
import pytest

from analysis.study.places import numbers_at, replaced
from sim_backend.errors import ConfigError
from sim_backend.model import load_model


@pytest.fixture(scope="module")
def content() -> dict[str, Any]:
    return msgspec.to_builtins(load_model("as-built"))


@pytest.mark.parametrize(
    ("place", "values"),
    [
        ("modes[theta_y suspension].frequency_hz", [29.4775]),  # a table with its origin
        ("modes[theta_? mirror on its support].input.torque_*", [-3254.16754947, -3091.57186327]),
        ("effects[sensor-noise@s2].parameters.std", [4.0e-9]),
        ("effects[sensor-noise@*].parameters.std", [4.0e-9] * 3),
        ("hardware.actuators.radius_m", [0.02735]),
        ("sample_rate_hz", [10000.0]),
    ],
)
def test_a_place_means_the_numbers_of_the_file(content: dict[str, Any], place: str, values: list[float]) -> None:
    assert [n.value for n in numbers_at(content, place)] == values


def test_names_are_places_that_mean_one_number(content: dict[str, Any]) -> None:
    for number in numbers_at(content, "modes[*].output.*"):
        assert numbers_at(content, number.name) == [number]


def test_two_entries_with_one_label_keep_their_own_names() -> None:
    modes = [{"label": "m", "frequency_hz": 1.0}, {"label": "m", "frequency_hz": 2.0}]
    found = numbers_at({"modes": modes}, "modes[m].frequency_hz")
    assert [(n.name, n.value) for n in found] == [("modes[m].frequency_hz", 1.0), ("modes[m].frequency_hz#2", 2.0)]


def test_only_the_number_is_replaced(content: dict[str, Any]) -> None:
    before = copy.deepcopy(content)
    (number,) = numbers_at(content, "modes[theta_y suspension].frequency_hz")
    after = replaced(content, number.way, 31.0)
    assert content == before
    (again,) = numbers_at(after, number.name)
    assert again.value == 31.0
    assert after["modes"][number.way[1]].pop("frequency_hz") == {
        **before["modes"][number.way[1]].pop("frequency_hz"),
        "value": 31.0,
    }
    assert after == before


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("modes[theta_y suspensoin].frequency_hz", "did you mean 'theta_y suspension'"),
        ("modes[theta_y suspension].frequency", "did you mean 'frequency_hz'"),
        ("modes.frequency_hz", "choose an entry in brackets"),
        ("hardware", "go on to one below it"),
        ("title", "that is not a number"),
        ("modes[[x]].frequency_hz", "cannot be read"),
        ("effects[coulomb-friction@theta_x].parameters.torque", "no entry of 'effects'"),
    ],
)
def test_a_place_that_means_nothing_is_told_with_what_there_is(content: dict[str, Any], place: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        numbers_at(content, place)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
