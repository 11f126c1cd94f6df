"""What a user sees of an error: one line, the documented exit code, never a traceback."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import click
import pytest

from mccdcli.failures import exit_code_of
from sim_backend.errors import CheckError, ConfigError, DataError, HardwareError, MccdError

ROOT = Path(__file__).parents[2]


def raising(error: BaseException):
    def run() -> None:
        raise error

    return run


@pytest.mark.parametrize(
    ("error", "code"),
    # the numbers users script against (README), not those the classes carry
    [(MccdError, 1), (CheckError, 1), (ConfigError, 2), (HardwareError, 3), (DataError, 4)],
)
def test_an_error_of_ours_is_one_line_and_its_exit_code(
    error: type[MccdError], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code_of(raising(error("RUN.h5: 3 samples,\n  at least 10 wanted"))) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert err == "mccd: error: RUN.h5: 3 samples, at least 10 wanted\n"


@pytest.mark.parametrize(("returned", "code"), [(None, 0), (0, 0), (1, 1), ("text", 0)])
def test_a_command_may_return_its_exit_code(returned: object, code: int) -> None:
    assert exit_code_of(lambda: returned) == code


@pytest.mark.parametrize("error", [click.Abort(), KeyboardInterrupt()])
def test_an_interrupt_ends_with_130(error: BaseException, capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code_of(raising(error)) == 130
    assert capsys.readouterr().err == "mccd: interrupted\n"


def test_the_state_of_the_disk_is_no_bug(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code_of(lambda: Path("/no/such/folder/file").read_text()) == 4
    said = "/no/such/folder/file: No such file or directory; check the folder, its rights and the free space"
    assert capsys.readouterr().err == f"mccd: error: {said}\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
@pytest.mark.parametrize("arguments", [("bench", "list"), ("bench", "list", "--json"), ("--help",)])
def test_a_full_disk_behind_the_standard_output_is_no_bug(arguments: tuple[str, ...]) -> None:
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "mccdcli", *arguments]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
    assert done.returncode == 4
    assert done.stderr.startswith("mccd: error: No space left on device; check") and done.stderr.count("\n") == 1


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
@pytest.mark.parametrize(
    ("shell", "code"),
    [
        ("mccd bench nonsense 2>/dev/full", 2),
        ("mccd bench list >/dev/full 2>/dev/full", 4),
        ("mccd bench list >&-", 0),
        ("mccd bench nonsense 2>&-", 2),
        ("mccd bench list <&- >&- 2>&-", 0),
        ("(mccd bench nonsense; echo $? >code) 2>&1 | true", 2),
    ],
)
def test_the_exit_code_holds_where_nothing_can_be_said(shell: str, code: int, tmp_path: Path, log_folder: Path) -> None:
    script = shell if ">code" in shell else f"({shell}); echo $? >code"
    script = script.replace("mccd", f"{sys.executable} -m mccdcli")
    done = subprocess.run(["sh", "-c", script], cwd=tmp_path, capture_output=True, timeout=60)
    assert (tmp_path / "code").read_text() == f"{code}\n"
    assert (done.stdout, done.stderr) == (b"", b"")
    assert not any(log_folder.rglob("crash-*"))


@pytest.mark.parametrize("error", [ZeroDivisionError("division by zero"), OSError("no file named"), KeyError("x")])
def test_a_bug_is_one_line_that_names_a_file_with_the_traceback(
    error: Exception, log_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code_of(raising(error)) == 70
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("mccd: error: this is a bug in mccd (")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    crash_file = Path(err.rstrip("\n").rpartition(" ")[2])
    assert log_folder in crash_file.parents
    text = crash_file.read_text()
    assert "Traceback (most recent call last)" in text
    assert type(error).__name__ in text
    assert "mccd " in text.partition("\n")[0]


def test_a_bug_is_reported_even_where_the_log_folder_cannot_be_made(
    log_folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (log_folder / "a-file").touch()
    monkeypatch.setenv("XDG_STATE_HOME", str(log_folder / "a-file"))
    monkeypatch.setenv("HOME", str(log_folder / "a-file"))
    monkeypatch.setattr("tempfile.tempdir", str(log_folder))
    assert exit_code_of(raising(ZeroDivisionError())) == 70
    crash_file = Path(capsys.readouterr().err.rstrip("\n").rpartition(" ")[2])
    assert "ZeroDivisionError" in crash_file.read_text()


def test_wrong_usage_is_one_line_that_says_where_help_is(mccd) -> None:
    done = mccd("--nonsense")
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == "mccd: error: No such option '--nonsense'. (see 'mccd --help')\n"


def test_a_mistyped_command_is_answered_with_the_nearest(mccd) -> None:
    done = mccd("idenify")
    assert done.returncode == 2
    assert done.stderr == ("mccd: error: No such command 'idenify'. Did you mean 'identify'? (see 'mccd --help')\n")


def test_no_command_shows_the_help_and_counts_as_wrong_usage(mccd) -> None:
    done = mccd()
    assert done.returncode == 2
    assert done.stdout == ""
    assert "Usage: mccd" in done.stderr


def test_the_help_documents_every_exit_code(mccd) -> None:
    done = mccd("--help")
    assert done.returncode == 0
    assert done.stderr == ""
    documented = done.stdout.partition("Exit codes:")[2].split()
    for code in ("0", "1", "2", "3", "4", "70", "130"):
        assert code in documented


def test_a_reader_that_goes_away_is_no_error() -> None:
    with subprocess.Popen(
        [sys.executable, "-m", "mccdcli", "--help"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait(timeout=60) == 141


def test_ctrl_c_ends_a_command_without_a_traceback(tmp_path: Path) -> None:
    (tmp_path / "waiting.py").write_text(
        "import click, sys, time\n@click.command()\ndef wait():\n    print('ready', flush=True)\n    time.sleep(60)\n"
    )
    script = (
        # whoever starts the tests in the background has told them, and thereby this process, to ignore Ctrl-C
        "import signal, sys\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        f"sys.path.insert(0, {str(tmp_path)!r})\n"
        "from mccdcli.failures import exit_code_of\n"
        "from mccdcli.main import run\n"
        "from mccdcli.lazy import LazyGroup\n"
        "from mccdcli.registry import Entry\n"
        "tree = LazyGroup('mccd', {'wait': Entry('waiting:wait', '')}, {}, help='')\n"
        "sys.exit(exit_code_of(lambda: run(tree, ['wait'])))\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        assert process.stdout.readline() == "ready\n"
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 130
        assert process.stderr.read().strip() == "mccd: interrupted"


def test_the_version_says_which_release_and_which_commit(mccd) -> None:
    done = mccd("--version")
    assert (done.returncode, done.stderr) == (0, "")
    assert re.fullmatch(r"mccd \d+\.\d+\.\d+\S* \(commit ([0-9a-f]{7,}(-dirty)?|unknown)\)\n", done.stdout)


def test_a_bug_is_reported_even_where_nothing_can_be_written(
    log_folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (log_folder / "a-file").touch()
    monkeypatch.setenv("XDG_STATE_HOME", str(log_folder / "a-file"))
    monkeypatch.setattr("tempfile.tempdir", str(log_folder / "a-file"))
    assert exit_code_of(raising(ZeroDivisionError())) == 70
    err = capsys.readouterr().err
    assert "no file with the details could be written" in err and err.count("\n") == 1


NOBODY = ("unshare", "--user", "--map-user=4321")
"""A user that the system does not know, as in many containers; without HOME there is no home either."""


@pytest.mark.parametrize(
    ("arguments", "code"), [(("bench", "list"), 0), (("config", "show", "chop"), 0), (("log", "show", "x.h5"), 2)]
)
def test_a_user_without_a_home(arguments: tuple[str, ...], code: int, tmp_path: Path) -> None:
    if shutil.which("unshare") is None or subprocess.run([*NOBODY, "true"], capture_output=True).returncode:
        pytest.skip("needs unshare, and the right to make a namespace of users")
    done = subprocess.run(
        [*NOBODY, sys.executable, "-m", "mccdcli", *arguments],
        cwd=tmp_path,
        env={"PATH": os.environ["PATH"], "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr and "bug" not in done.stderr
    assert list(tmp_path.iterdir()) == []  # and no folder named ~
