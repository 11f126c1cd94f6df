"""Defaults from files and variables: which one holds, and that `mccd config show` says so."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Any

import click
import pytest

from analysis.diagnosis.pipeline import Options
from mccdcli.main import cli, main
from mccdcli.settings import options_of
from sim_backend.errors import ConfigError


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    return tmp_path


def shown(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, dict[str, Any]]:
    capsys.readouterr()
    assert main(["config", "show", "--json", *arguments]) == 0
    return json.loads(capsys.readouterr().out)["commands"]


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def test_an_option_beats_a_variable_that_a_file_that_the_default(here, log_folder, monkeypatch, capsys):
    def cycles(*arguments: str) -> tuple[object, object, object]:
        one = shown(capsys, "chop", *arguments)["chop"]["cycles"]
        return one["value"], one["origin"], one["where"]

    home = log_folder / ".config" / "mccd" / "config.toml"
    assert cycles() == (15, "default", "")
    write(home, "[chop]\ncycles = 3\n")
    assert cycles() == (3, "file", str(home))
    write(here / "mccd.toml", "[chop]\ncycles = 4\n")
    assert cycles() == (4, "file", "mccd.toml")
    monkeypatch.setenv("MCCD_CHOP_CYCLES", "5")
    assert cycles() == (5, "environment", "MCCD_CHOP_CYCLES")
    assert cycles("--cycles", "6") == (6, "option", "--cycles")


def test_what_is_shown_is_what_a_command_does(here, capsys):
    write(
        here / "mccd.toml",
        "[defaults]\nseed = 11\n\n[simulate]\nplan = 'freerun'\ndry-run = true\n\n[log.show]\njson = true\n",
    )
    assert main(["simulate"]) == 0
    assert not (here / "simulate.h5").exists() and "freerun" in capsys.readouterr().out
    assert main(["chop", "--set", "cycles=1", "--out", "c.h5"]) in (0, 1)
    capsys.readouterr()
    assert main(["log", "show", "c.h5"]) == 0
    assert json.loads(capsys.readouterr().out)["seed"] == 11


def test_the_table_for_all_holds_only_where_the_option_means_the_same(here, capsys):
    write(here / "mccd.toml", "[defaults]\nbench = 'emulator'\n")
    found = shown(capsys)
    assert found["chop"]["bench"]["value"] == "emulator"
    assert "diagnose" not in found  # its --bench asks for a chop besides


def test_without_a_command_all_that_is_not_default(capsys, monkeypatch):
    assert shown(capsys) == {}
    monkeypatch.setenv("MCCD_SEED", "9")
    found = shown(capsys)
    assert found["chop"] == {
        "seed": {"value": 9, "origin": "environment", "where": "MCCD_SEED", "variable": "MCCD_SEED"}
    }
    assert main(["config", "show"]) == 0
    assert "environment MCCD_SEED" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[chpo]\ncycles = 3\n", ("mccd.toml", "'chpo'", "did you mean 'chop'?")),
        ("[chop]\ncylces = 3\n", ("mccd.toml", "'cylces'", "did you mean 'cycles'?")),
        ("[log.shwo]\njson = true\n", ("mccd.toml", "'log shwo'", "did you mean 'show'?")),
        ("[defaults]\nsed = 3\n", ("mccd.toml", "'sed'", "did you mean 'seed'?")),
        ("[chop\n", ("mccd.toml", "not valid TOML")),
        ("chop = 3\n", ("mccd.toml", "'chop' is in no table", "[COMMAND]")),
        ("[chop]\ncycles = 'many'\n", ("--cycles", "'many'")),
    ],
)
def test_a_mistake_in_a_file_is_told_in_one_line(here, text, words, capsys):
    write(here / "mccd.toml", text)
    assert main(["chop", "--dry-run"]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and all(word in err for word in words), err


def test_a_file_named_by_a_variable_must_exist_and_is_the_only_one(here, monkeypatch, capsys):
    write(here / "mccd.toml", "[chop]\ncycles = 4\n")
    monkeypatch.setenv("MCCD_CONFIG", str(here / "other.toml"))
    assert main(["chop", "--dry-run"]) == 2
    assert "other.toml" in capsys.readouterr().err
    write(here / "other.toml", "[chop]\nalpha = 90\n")
    found = shown(capsys)["chop"]
    assert list(found) == ["alpha"] and found["alpha"]["value"] == 90.0


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [
        (("chpo",), "chop"),
        (("log", "shwo"), "show"),
        (("chop", "--cylces", "3"), "--cycles"),
        (("chop", "--set", "cycels=3", "--dry-run"), "cycles"),
        (("chop", "--strategy", "hybird", "--dry-run"), "hybrid"),
        (("chop", "--model", "desing", "--dry-run"), "design"),
        (("chop", "--bench", "smi"), "sim"),
        (("simulate", "--plan", "chpo"), "chop"),
        (("campaign", "show", "papr"), "paper"),
    ],
)
def test_a_mistyped_name_is_answered_with_the_one_that_was_meant(arguments, meant, capsys):
    assert main(list(arguments)) == 2
    assert f"id you mean '{meant}'?" in capsys.readouterr().err


def test_an_effect_to_leave_out_that_is_mistyped_too():
    with pytest.raises(ConfigError, match="did you mean 'hysteresis'"):
        Options(without=("hysteresys",))


@pytest.mark.parametrize(
    ("line", "command", "why"),
    [
        ("[defaults]\nbench = 'tcp:192.0.2.1:5025'\n", "chop", "opens a line to a bench"),
        ("[chop]\nbench = 'serial:/dev/ttyUSB0'\n", "chop", "opens a line to a bench"),
        ("[study]\ncluster = 'tcp://192.0.2.1:8786'\n", "study", "programs on a cluster run what it sends"),
        ("[chop]\nout = '../elsewhere.h5'\n", "chop", "writes outside this folder"),
        ("[bench.serve]\nlink = '/tmp/elsewhere'\n", "bench serve", "writes outside this folder"),
        ("[import]\nallow-outside = true\n", "import", "lets maps read files outside their folder"),
        ("[bench.serve]\nallow_remote = true\n", "bench serve", "opens a bench to other machines"),
        ("[bench.serve]\nhost = '0.0.0.0'\n", "bench serve", "opens a bench to other machines"),
        ("[bench.serve]\ntoken-file = 'token'\n", "bench serve", "decides who may command a bench"),
        ("[identify]\nforce = true\n", "identify", "replaces what is there"),
    ],
)
def test_a_file_of_the_current_folder_reaches_nothing_outside(
    here, log_folder, monkeypatch, capsys, line, command, why
):
    def code() -> int:
        return main(["config", "show", "--json", *command.split()])

    own = log_folder / ".config" / "mccd" / "config.toml"
    write(here / "mccd.toml", line)
    assert code() == 2
    said = capsys.readouterr().err
    for part in ("mccd.toml sets ", why, f"move the line to {own}", f"or give --{line.split()[1].replace('_', '-')}"):
        assert part in said
    monkeypatch.setenv("MCCD_CONFIG", "mccd.toml")
    assert code() == 0
    monkeypatch.delenv("MCCD_CONFIG")
    (here / "mccd.toml").unlink()
    write(own, line)
    assert code() == 0
    assert line.partition(" = ")[2].strip().strip("'") in capsys.readouterr().out


def test_a_file_of_the_current_folder_may_name_what_is_simulated_and_what_lies_in_it(here, capsys):
    write(here / "mccd.toml", "[defaults]\nbench = 'sim:model.toml'\n\n[chop]\nout = 'runs/chop.h5'\n")
    found = shown(capsys, "chop")["chop"]
    assert (found["bench"]["value"], found["out"]["value"]) == ("sim:model.toml", "runs/chop.h5")


@pytest.mark.parametrize("path", cli.paths(), ids=" ".join)
def test_every_option_of_every_command_has_the_variable_of_its_long_name(path, monkeypatch):
    ctx = click.Context(cli, info_name="mccd", auto_envvar_prefix="MCCD")
    for word in path:
        assert isinstance(ctx.command, click.Group)
        command = ctx.command.get_command(ctx, word)
        assert command is not None
        ctx = click.Context(command, parent=ctx, info_name=word)
    before = "_".join(("MCCD", *path)).upper()
    options = dict(options_of(ctx.command))
    variables = {name: f"{before}_{name}".upper().replace("-", "_") for name in options}
    for name, option in options.items():
        for variable in (variables[name], f"{before}_{option.name}".upper()):  # as written in Python: so until now
            with monkeypatch.context() as environment:
                environment.setenv(variable, "given")
                read = [n for n, one in options.items() if one.resolve_envvar_value(ctx) == "given"]
            assert read == [name], variable


def test_a_variable_under_the_name_in_python_holds_where_the_long_name_sets_nothing(here, monkeypatch, capsys):
    def limit() -> tuple[object, object]:
        one = shown(capsys, "challenge", "run")["challenge run"]["time-limit"]
        assert one["origin"] == "environment" and one["variable"] == "MCCD_CHALLENGE_RUN_TIME_LIMIT"
        return one["value"], one["where"]

    monkeypatch.setenv("MCCD_CHALLENGE_RUN_LIMIT_S", "30")
    assert limit() == (30, "MCCD_CHALLENGE_RUN_LIMIT_S")
    monkeypatch.setenv("MCCD_CHALLENGE_RUN_TIME_LIMIT", "60")
    assert limit() == (60, "MCCD_CHALLENGE_RUN_TIME_LIMIT")


def test_a_variable_sets_what_a_command_does(here, monkeypatch, capsys):
    monkeypatch.setenv("MCCD_SIMULATE_SET", "nothing=1")
    assert main(["simulate", "--plan", "freerun", "--dry-run"]) == 2
    assert "nothing" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "option", "given"),
    [
        ("chop", "form", "-3:+8.5"),
        ("diagnose", "nominal-tolerance", "2%"),
        ("design", "tolerance", "0.25%"),
        ("log list", "since", "2026-03-01T12:00:00+01:00"),
        ("log list", "since", "2026-03-01"),
        ("chop", "alpha", "90"),
        ("chop", "set", "cycles=3"),
        ("chop", "set", "tuning.learning_s=2 --set cycles=3"),
        ("diagnose", "without", "hysteresis --without delay"),
        ("design", "log", "a.h5 --log b.h5"),
        ("chop", "note", "'after the repair & cold'"),
        ("chop", "cycles", "many"),  # refused, but that is what is set
    ],
)
def test_a_value_is_shown_as_one_types_it(command, option, given, capsys):
    assert row(capsys, command, option, *shlex.split(f"--{option} {given}")) == (given, f"option --{option}")


@pytest.mark.parametrize(
    ("command", "option", "line", "typed"),
    [
        ("chop", "dry-run", "dry-run = true", "true"),
        ("diagnose", "page", "page = false", "false"),
        ("chop", "set", "set = ['cycles=3', 'repeats=2']", "cycles=3 --set repeats=2"),
        ("chop", "form", "form = '-3:+8.5'", "-3:+8.5"),
        ("chop", "cycles", "cycles = 3", "3"),
        ("chop", "note", "note = ''", "none"),
    ],
)
def test_a_value_of_a_file_is_shown_as_one_types_it(command, option, line, typed, here, capsys):
    write(here / "mccd.toml", f"[{command}]\n{line}\n")
    assert row(capsys, command, option) == (typed, "file mccd.toml")


def row(capsys: pytest.CaptureFixture[str], command: str, option: str, *arguments: str) -> tuple[str, str]:
    """Return the value and the origin of an option as they are printed."""
    assert main(["config", "show", *command.split(), *arguments]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if line.startswith(f"--{option} "))
    _, value, origin, _ = re.split(r" {2,}", line)
    return value, origin


def test_the_default_of_a_flag_is_shown_as_a_file_holds_it(capsys):
    assert row(capsys, "chop", "dry-run") == ("false", "default")
    assert row(capsys, "diagnose", "page") == ("true", "default")
    assert row(capsys, "chop", "set") == row(capsys, "chop", "note") == ("none", "default")


def test_the_default_that_is_shown_is_that_of_the_help(capsys):
    for path in cli.paths():
        command: click.Command = cli
        named = " ".join(path)
        for word in path:
            assert isinstance(command, click.Group)
            below = command.get_command(click.Context(command), word)
            assert below is not None
            command = below
        context = click.Context(command)
        for name, option in options_of(command):
            helped = re.search(r"\[default: ([^];]+)", (option.get_help_record(context) or ("",))[-1])
            if helped and not option.is_flag:
                assert row(capsys, named, name) == (helped[1], "default"), f"{named} --{name}"
    assert row(capsys, "diagnose", "expect") == ("consistent", "default")
    assert shown(capsys, "diagnose")["diagnose"]["expect"]["value"] == "consistent"


def test_a_note_is_in_the_json_too(capsys):
    assert shown(capsys, "chop", "--note", "after the repair")["chop"]["note"]["value"] == "after the repair"


@pytest.mark.parametrize(
    ("command", "option", "typed", "fraction", "largest"),
    [
        ("diagnose", "nominal-tolerance", "3%", 0.03, 100),
        ("investigate", "nominal-tolerance", "1.73 %", 0.0173, 100),
        ("design", "tolerance", "0.1%", 0.001, 50),
    ],
)
def test_a_share_is_typed_in_percent_and_never_bare(command, option, typed, fraction, largest, here, capsys):
    write(here / "run.h5", "")
    words = [command, "--model", "design", *(["run.h5"] if command == "diagnose" else [])]

    def refusal(*arguments: str) -> str:
        capsys.readouterr()
        assert main([*words, *arguments]) == 2
        return capsys.readouterr().err

    assert shown(capsys, command, f"--{option}", typed)[command][option]["value"] == fraction
    assert "0.02 may be a fraction or percent; write 2% or 0.02%." in refusal(f"--{option}", "0.02")
    assert f"<{largest}." in refusal(f"--{option}", f"{largest + 1}%").replace("=", "")
    write(here / "mccd.toml", f"[{command}]\n{option} = 0.02\n")  # a file says what one types
    assert "write 2% or 0.02%" in refusal()
