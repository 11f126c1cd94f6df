"""`mccd model effects` tells of every effect what a model file needs to hold it."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from mccdcli.main import cli
from sim_backend.effects import NAMED, make_effect


@pytest.fixture(scope="module")
def listed() -> list[dict[str, Any]]:
    done = CliRunner().invoke(cli, ["model", "effects", "--json"])
    assert done.exit_code == 0
    return json.loads(done.stdout)["effects"]


def test_it_lists_all_effects_with_the_parameters_that_make_them(listed: list[dict[str, Any]]) -> None:
    assert [one["effect"] for one in listed] == [effect.name for effect in NAMED]
    for one in listed:
        values = {p["name"]: np.inf if p["without"] is None else p["without"] for p in one["parameters"]}
        # made with the names as listed, the values that are told to stand for none make none
        assert make_effect(str(one["effect"]), "theta_x", values).is_neutral()


def test_one_effect_is_described_with_units() -> None:
    done = CliRunner().invoke(cli, ["model", "effects", "cubic-stiffness"])
    assert done.exit_code == 0 and "N m/rad^3" in done.stdout and "cube of the deflection" in done.stdout


def test_an_effect_that_is_none_is_refused_with_the_next_of_name() -> None:
    from mccdcli.failures import exit_code_of

    code = exit_code_of(lambda: cli.main(["model", "effects", "backlsh"], standalone_mode=False))
    assert code == 2
