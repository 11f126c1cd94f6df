"""The common options: their forms, their defaults, and that a command gets the ones it names."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner

from mccdcli.idle_options import refuse_typed
from mccdcli.options import OPTIONS, common_options


def parse(arguments: list[str], *names: str) -> dict[str, Any]:
    got: dict[str, Any] = {}

    @click.command()
    @common_options(*names)
    def command(**values: Any) -> None:
        got.update(values)

    done = CliRunner().invoke(command, arguments)
    assert done.exit_code == 0, done.output
    return got


def test_all_of_them_with_their_defaults() -> None:
    assert parse([]) == {"bench": "sim", "out": None, "seed": 0, "dry_run": False, "as_json": False}


def test_all_of_them_given() -> None:
    arguments = ["--bench", "tcp:localhost:5025", "-o", "runs", "--seed", "7", "--dry-run", "--json"]
    expected = {
        "bench": "tcp:localhost:5025",
        "out": Path("runs"),
        "seed": 7,
        "dry_run": True,
        "as_json": True,
    }
    assert parse(arguments) == expected


def test_only_those_named() -> None:
    assert parse(["--json"], "json", "out") == {"out": None, "as_json": True}


def test_a_name_that_is_no_option_is_refused_when_the_command_is_written() -> None:
    with pytest.raises(ValueError, match=r"no common option \['jsn'\]"):
        common_options("jsn")


def test_help_shows_them_in_one_order_whatever_the_order_of_naming() -> None:
    @click.command()
    @common_options("json", "bench", "seed")
    def command(**values: Any) -> None: ...

    text = CliRunner().invoke(command, ["--help"]).output
    assert text.index("--bench") < text.index("--seed") < text.index("--json")
    assert list(OPTIONS) == ["bench", "out", "seed", "dry_run", "note", "json"]


@pytest.mark.parametrize(
    "address",
    [
        "sim",
        "sim:printed",
        "emulator",
        "emulator:my models/bench.toml",
        "serial:/dev/ttyUSB0",
        "serial:/dev/ttyUSB0@921600",
        "serial:COM3",
        "tcp:bench.local:5025",
        "tcp:[::1]:5025",
    ],
)
def test_a_bench_address_is_passed_on_as_it_stands(address: str) -> None:
    assert parse(["--bench", address])["bench"] == address


@pytest.mark.parametrize(
    "address",
    [
        "",
        "sim:",
        "emulator:",
        "serial:",
        "serial",
        "tcp:host",
        "tcp::5025",
        "tcp:host:",
        "tcp:h:0",
        "tcp:h:65536",
        "tcp:h:x",
    ],
)
def test_a_bench_address_without_its_form_is_refused(address: str) -> None:
    @click.command()
    @common_options("bench")
    def command(bench: str) -> None: ...

    done = CliRunner().invoke(command, ["--bench", address])
    assert done.exit_code == 2
    known = "sim[:MODEL], emulator[:MODEL], serial:DEVICE[@BAUD], tcp:HOST:PORT"
    assert f"{address!r} is not a bench; a bench is {known}." in done.output
    # the part that is wrong is named, once it is plain which kind is meant
    assert not address or re.search(r"(MODEL|DEVICE|HOST|PORT) is (missing|'.*')", done.output.partition(known)[2])


def test_a_mistyped_bench_is_answered_with_the_nearest() -> None:
    @click.command()
    @common_options("bench")
    def command(bench: str) -> None: ...

    assert "Did you mean 'emulator'?" in CliRunner().invoke(command, ["--bench", "emulater"]).output


@pytest.mark.parametrize(
    ("arguments", "refused"),
    [
        ([], ""),
        (["--bench", "sim"], "--bench"),
        (["--seed", "0"], "--seed"),
        (["-o", "a"], "--out"),
        (["--dry-run"], "--dry-run"),
        (["--note", "mine"], "--note"),
        (["--json"], ""),
    ],
)
def test_what_is_typed_without_effect_is_refused_and_what_is_set_is_not(arguments, refused, monkeypatch) -> None:
    @click.command()
    @common_options()
    def command(**_: Any) -> None:
        refuse_typed(("bench", "seed", "out", "dry_run", "note"), "has no effect here")

    monkeypatch.setenv("MCCD_BENCH", "sim:design")
    monkeypatch.setenv("MCCD_SEED", "3")
    done = CliRunner().invoke(command, arguments)
    assert done.exit_code == (2 if refused else 0), done.output
    assert f"{refused} has no effect here" in done.output if refused else "no effect" not in done.output
