"""What every command prints with --json is what its schema says, no value more and none less."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import msgspec
import pytest

from mccdcli.main import cli, main
from mccdcli.registry import COMMANDS
from mccdcli.schema import described, names, schema_of
from mccdcli.settings import options_of
from sim_backend.model import dump_model
from tests.designed import designed
from tests.small_bench import NOISE, bench_model

SHORT_SWEEP = "bands=[{start_hz=20.0, stop_hz=40.0, step_hz=5.0, settle_s=0.3, measure_s=0.2}]"
CAMPAIGN = (
    'schema = "mccd-campaign/1"\nname = "mine"\n[[runs]]\nname = "one"\nplan = "chop"\nsettings = { cycles = 1 }\n'
)
MAP = """[log]
test = "x"
source = "data.csv"
sample_rate_hz = 100.0
[channels.u]
select = "u"
unit = "N m"
role = "input"
"""

QUICK = (
    "--first multisine --set axes=['theta_x'] --set realisations=1 --set period_s=0.5 --set start_hz=2.0 "
    "--set stop_hz=500.0"
).split()

# in an order in which each finds what it needs; report is checked by the contract of its tables, a diagnosis with
# causes by the tutorial, a design below
CALLS = {
    "simulate": ["--plan", "sinesweep", "--set", "axis=theta_x", "--set", SHORT_SWEEP, "--out", "sweep.h5"],
    "identify": ["--log", "sweep.h5", "--modes", "1", "-o", "one.toml"],
    "compare": ["one.toml", "design"],
    "log check": ["sweep.h5"],
    "log list": ["."],
    "log plot": ["sweep.h5"],
    "log show": ["sweep.h5"],
    "log summary": ["sweep.h5"],
    "log verify": ["sweep.h5"],
    "log recover": ["sweep.h5", "-o", "saved.h5"],
    "log export": ["sweep.h5", "-o", "sweep.npz"],
    "watch": ["sweep.h5", "--once", "--model", "design"],
    "chop": ["--cycles", "1", "--set", "frequency_hz=2.0", "--set", "window_s=0.1"],
    "settle": ["--cycles", "3"],
    "hysteresis": ["--set", "torques_nm=[0.08]", "--set", "frequency_hz=2.0"],
    "endstops": ["--set", "settle_s=0.1", "--set", "hold_s=0.1"],
    "theodolite": ["--set", "x_rad=[-6e-3, 6e-3]", "--set", "y_rad=[-6e-3, 6e-3]"],
    "thermal": ["--no-sweeps", "--set", "cycles=12"],
    "campaign run": ["mine.toml", "--out", "mine"],
    "campaign show": ["mine"],
    "campaign list": [],
    "bench list": [],
    "model convert": ["design", "-o", "design.json"],
    "model effects": [],
    "config show": ["chop"],
    "import": ["map.toml", "-o", "imported.h5"],
    "bench check": ["--bench", "emulator"],
    "challenge make": ["blind", "--family", "end-stop-contact", "--shape", "short", "--seed", "11"],
    "challenge run": ["blind"],
    "challenge score": ["blind", "-o", "score"],
    "challenge pool": ["score.json", "-o", "pooled"],
    "investigate": ["--bench", "sim:bench.toml", "--model", "nominal.toml", "-o", "rounds", *QUICK],
    "diagnose": ["rounds/round-1/multisine.h5", "--model", "nominal.toml", "--no-page", "-o", "diagnosis"],
}


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("json")
    (folder / "mine.toml").write_text(CAMPAIGN)
    (folder / "map.toml").write_text(MAP)
    for name, effects in (("bench", NOISE), ("nominal", ())):
        model = msgspec.structs.replace(bench_model(effects), sample_rate_hz=2000.0)
        (folder / f"{name}.toml").write_text(dump_model(model), encoding="utf-8")
    (folder / "data.csv").write_text("u\n" + "\n".join(str((7919 * i) % 13) for i in range(100)) + "\n")
    return folder


def takes_json(name: str) -> bool:
    command = cli.find(tuple(name.split()))
    assert command is not None
    return any(option == "json" for option, _ in options_of(command))


def test_every_command_with_json_has_a_schema_and_no_other() -> None:
    assert set(names()) == {name for name in COMMANDS if takes_json(name)}


@pytest.mark.parametrize("name", names())
def test_a_schema_is_one_and_describes_every_value(name: str) -> None:
    schema = schema_of(name, dry_run=True)
    jsonschema.Draft202012Validator.check_schema(schema)
    assert described(name).count("\n| `") == json.dumps(schema_of(name)).count('"description"')


@pytest.mark.parametrize("name", CALLS)
def test_a_result_is_as_its_schema_says(name: str, home: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(home)
    # 1 where a requirement is missed: so short a test proves nothing of the bench
    before = ["--json"] if name == "config show" else []
    assert main([*name.split(), *before, *CALLS[name], *([] if before else ["--json"])]) in (0, 1)
    jsonschema.validate(json.loads(capsys.readouterr().out), schema_of(name))


def test_the_diagnosis_of_a_round_is_as_the_schema_of_diagnoses_says(home: Path) -> None:
    found = home / "rounds" / "round-1" / "diagnosis" / "diagnosis.json"
    jsonschema.validate(json.loads(found.read_text(encoding="utf-8")), schema_of("diagnose"))


def test_a_design_with_all_its_stages_is_as_its_schema_says() -> None:
    jsonschema.validate(json.loads((designed() / "printed.json").read_text(encoding="utf-8")), schema_of("design"))


@pytest.mark.parametrize(("name", "more"), [("chop", []), ("campaign run", ["mine.toml"])])
def test_a_dry_run_is_as_the_schema_says(name: str, more: list[str], home: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(home)
    assert main([*name.split(), *more, "--json", "--dry-run"]) == 0
    jsonschema.validate(json.loads(capsys.readouterr().out), schema_of(name, dry_run=True))


def test_lists_of_plans_and_files_of_campaigns_too(home: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(home)
    for name, arguments in (("campaign list", ["--plans"]), ("campaign show", ["mine.toml"])):
        assert main([*name.split(), *arguments, "--json"]) == 0
        jsonschema.validate(json.loads(capsys.readouterr().out), schema_of(name))


def test_a_value_too_many_or_of_another_type_is_refused() -> None:
    good = {"file": "a", "name": "b"}
    schema = schema_of("model convert")
    jsonschema.validate(good, schema)
    for bad in ({**good, "more": 1}, {"file": "a"}, {**good, "name": 3}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(bad, schema)


def test_the_command_prints_it(capsys) -> None:
    assert main(["schema", "log", "show"]) == 0
    assert json.loads(capsys.readouterr().out) == schema_of("log show")
    assert main(["schema", "chop"]) == 0
    assert "anyOf" in json.loads(capsys.readouterr().out)
    assert main(["schema", "chpo"]) == 2
    assert "did you mean 'chop'?" in capsys.readouterr().err
