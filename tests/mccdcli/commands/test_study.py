"""`mccd study` as its users run it: results, files, exit codes and refusals."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest

from mccdcli.main import main
from mccdcli.schema import schema_of

STUDY = """
schema = "mccd-study/1"
name = "small"
kind = "settling"
trials = 3
[settings]
cycles = 2
[[vary]]
place = "settings.strategy"
sweep = ["hybrid", "mbff"]
"""
UNSTABLE = '[[vary]]\nplace = "model.modes[theta_y suspension].input.torque_y"\nsweep = [-3091.7]\n'


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "study.toml"
    path.write_text(STUDY)
    return path


def test_a_study_ends_with_tables_files_and_0(study: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", str(study)]) == 0
    out = capsys.readouterr().out
    assert "settings.strategy = mbff" in out and "3 done" in out and "6 trials in" in out
    assert {p.name for p in (study.parent / "small").iterdir()} == {
        "trials.sqlite",
        "trials.csv",
        "study.json",
        "study.svg",
    }


def test_json_is_as_its_schema_says_and_holds_the_file(study: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for more, status in ((["--dry-run"], "dry run"), ([], "complete")):
        assert main(["study", str(study), "--json", *more]) == 0
        found = json.loads(capsys.readouterr().out)
        jsonschema.validate(found, schema_of("study"))
        assert (found["status"], found["total"]) == (status, 6)
    written = json.loads((study.parent / "small" / "study.json").read_text())
    assert {k: found[k] for k in written} == written


def test_a_dry_run_shows_what_varies_and_writes_nothing(study: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", str(study), "--dry-run"]) == 0
    assert "6 trials: 3 draws at 2 points" in capsys.readouterr().out
    assert not (study.parent / "small").exists()


def test_a_study_is_not_begun_twice_by_accident(study: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", str(study)]) == 0
    capsys.readouterr()
    assert main(["study", str(study)]) == 2
    assert "--resume" in capsys.readouterr().err
    assert main(["study", str(study), "--resume"]) == 0
    assert "trials in" not in capsys.readouterr().out  # nothing was left to do
    study.write_text(STUDY.replace("cycles = 2", "cycles = 3"))
    assert main(["study", str(study), "--resume"]) == 2
    error = capsys.readouterr().err
    assert "not the same study in its settings" in error and error.count("\n") == 1


def test_a_study_of_which_nothing_came_is_a_failed_check(study: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study.write_text(STUDY + UNSTABLE)
    assert main(["study", str(study)]) == 1
    out = capsys.readouterr().out
    assert "0 done, 3 failed" in out and "unstable" in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--cluster", "localhost"], "not the address of a scheduler"),
        (["--cluster", "tcp://127.0.0.1:1", "--workers", "2"], "leave out one of the two"),
        (["--workers", "0"], "0 is not in the range"),
    ],
)
def test_wrong_options_are_refused(
    arguments: list[str], words: str, study: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study", str(study), *arguments]) == 2
    assert words in capsys.readouterr().err


def test_markup_in_a_study_reaches_neither_terminal_nor_figure(study: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study.write_text(STUDY.replace('name = "small"', 'name = "small"\ntitle = "<script>\\u001b[31m$x$"'))
    assert main(["study", str(study)]) == 0
    captured = capsys.readouterr()
    assert "\x1b" not in captured.out + captured.err
    assert "<script>" not in (study.parent / "small" / "study.svg").read_text()
