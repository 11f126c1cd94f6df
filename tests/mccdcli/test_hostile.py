"""Whatever users and files say, a command ends as documented: no bug, no traceback, nothing touched elsewhere."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import click
import pytest

from mccdcli.failures import MOST_CHARACTERS, exit_code_of
from mccdcli.main import cli
from mccdcli.options import Real, RealRange, WholeRange
from sim_backend.errors import ConfigError
from tests.running import MEASURED, PYTHON, REAL, mccd, unmeasured

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(("first", "cases"), [(0, 20), (20, 80), (1000, 100), (2000, 100), (3000, 100)])
def test_drawn_cases_of_every_command_end_as_documented(first: int, cases: int) -> None:
    # a fork of what is measured is measured too
    python = [sys.executable] if MEASURED else PYTHON
    words = [*python, "-m", "benchmarks.soak_hostile", "--first", str(first), "--cases", str(cases)]
    environment = unmeasured() | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{cases} cases, 0 broken" in done.stdout


def test_every_number_of_an_option_is_checked() -> None:
    for path in cli.paths():
        command = cli.find(path)
        assert command is not None
        for option in command.params:
            numeric = isinstance(option.type, click.types.FloatParamType | click.types.IntParamType)
            assert not numeric or isinstance(option.type, Real | RealRange | WholeRange), (path, option.name)


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e999"])
def test_a_number_that_is_not_finite_is_refused(value: str) -> None:
    for kind in (Real(), RealRange(0.0)):
        with pytest.raises(click.BadParameter, match="not a finite number|not in the range"):
            kind.convert(value, None, None)


def test_a_whole_number_has_64_bits() -> None:
    assert WholeRange(0).convert(str(2**63 - 1), None, None) == 2**63 - 1
    with pytest.raises(click.BadParameter, match="64 bits"):
        WholeRange(0).convert(str(2**63), None, None)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[chop]\nout = ["a", "b"]', "--out as ['a', 'b'], a list; it takes a text or a number"),
        ("[chop]\ncycles = { a = 1 }", "--cycles as {'a': 1}, a dict; it takes a text or a number"),
        ("[chop]\nseed = true", "--seed as True, a bool; it takes a text or a number"),
        ("[chop]\nseed = 1979-05-27", "--seed as 1979-05-27, a date; it takes a text or a number"),
        ("[chop]\ndry-run = 1", "--dry-run as 1, a int; it takes true or false"),
        ("[chop]\ncycles = 2.5", "'2.5' is not a valid integer"),
        ("[chop]\nalpha = nan", "nan is not a finite number"),
    ],
)
def test_settings_of_a_wrong_type_are_refused(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "mccd.toml").write_text(text)
    done = mccd("chop", "--dry-run", cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr


def test_a_table_in_place_of_a_value_of_another_file(tmp_path: Path) -> None:
    home = tmp_path / "home" / "mccd"
    home.mkdir(parents=True)
    (home / "config.toml").write_text("chop = 1")
    (tmp_path / "mccd.toml").write_text("[chop]\ncycles = 3")
    done = mccd("config", "show", "chop", cwd=tmp_path, env={"XDG_CONFIG_HOME": str(home.parent)})
    assert done.returncode == 0, done.stderr


def test_a_message_of_any_length_is_one_that_can_be_read(capsys: pytest.CaptureFixture[str]) -> None:
    def refuse() -> None:
        raise ConfigError(f"'{'x' * 10**6}' is no plan; choose another")

    assert exit_code_of(refuse) == 2
    said = capsys.readouterr().err
    assert len(said) < MOST_CHARACTERS + 100
    assert said.startswith("mccd: error: 'xxx") and said.endswith("is no plan; choose another\n")


def test_too_little_memory_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    def refuse() -> None:
        raise MemoryError("Unable to allocate 7 TiB")

    assert exit_code_of(refuse) == 4
    assert capsys.readouterr().err.startswith("mccd: error: there is not enough memory (Unable to allocate 7 TiB)")


def test_a_name_that_is_not_utf_8_is_refused(tmp_path: Path) -> None:
    words = [os.fsencode(word) for word in REAL] + [b"log", b"show", b"a\xff.h5"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert "'a\\udcff.h5' is not UTF-8" in done.stderr


def test_closed_streams_are_no_bug(tmp_path: Path) -> None:
    words = f'exec "{sys.executable}" -m mccdcli model convert design -o model.toml <&- >&- 2>&-'
    done = subprocess.run(["sh", "-c", words], cwd=tmp_path, timeout=60, env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert done.returncode == 0
    assert (tmp_path / "model.toml").read_text().startswith("schema")


def test_a_user_without_a_home_can_work(tmp_path: Path) -> None:
    code = (
        "import pwd, sys\n"
        "def nobody(*_): raise KeyError('nobody')\n"
        "pwd.getpwuid = pwd.getpwnam = nobody\n"
        "from mccdcli.main import main\n"
        "from mccdcli.crash import write_crash_file\n"
        "print(write_crash_file(ValueError('a')))\n"
        "sys.exit(main(['config', 'show', 'chop']))"
    )
    nobody = {k: v for k, v in os.environ.items() if k != "HOME" and not k.startswith("XDG_")}
    nobody |= {"PYTHONPATH": str(ROOT), "TMPDIR": str(tmp_path)}
    work = tmp_path / "work"
    work.mkdir()
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=work, env=nobody, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert Path(done.stdout.splitlines()[0]).parent.parent == tmp_path
    assert list(work.iterdir()) == []


def test_a_campaign_with_one_amplitude_is_reported(tmp_path: Path) -> None:
    (tmp_path / "one.toml").write_text(
        'name = "one"\n[[runs]]\nname = "loops"\nplan = "hysteresis"\n'
        "settings = { torques_nm = [0.02], frequency_hz = 50.0, offsets_rad = [] }\n"
    )
    done = mccd("report", "--campaign", "one.toml", "--no-design", "-o", "one", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "one" / "index.html").is_file()
