"""The result on standard output, everything else on standard error."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from mccdcli.output import emit, plain, say, table, visible, warnings_in_one_line
from sim_backend.errors import MccdWarning
from sim_backend.kernel_cache import VARIABLE, KernelCacheWarning
from tests import running


@dataclass(frozen=True)
class Settling:
    axis: str
    time_s: np.ndarray
    file: Path


def test_a_warning_of_ours_is_one_line_and_any_other_keeps_its_place(capsys: pytest.CaptureFixture[str]) -> None:
    assert issubclass(KernelCacheWarning, MccdWarning)
    usual = warnings.showwarning
    with pytest.warns(DeprecationWarning) as others, warnings_in_one_line():
        warnings.warn("the folder\n  is old", MccdWarning, stacklevel=1)
        warnings.warn("of a library", DeprecationWarning, stacklevel=1)
    assert capsys.readouterr() == ("", "mccd: warning: the folder is old\n")
    assert [str(one.message) for one in others] == ["of a library"]
    assert warnings.showwarning is usual


def test_a_kernel_cache_that_others_may_write_is_a_line_beside_the_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "kernels"
    folder.mkdir()
    folder.chmod(0o777)
    monkeypatch.setenv(VARIABLE, str(folder))
    short = ("simulate", "--model", "design", "--plan", "rest", "--set", "duration_s=0.01", "--set", "settle_s=0.01")
    done = running.mccd(*short, "--json", cwd=tmp_path, command=running.REAL)
    assert done.returncode == 0 and json.loads(done.stdout)["plan"] == "rest"
    said = [line for line in done.stderr.splitlines() if " left" not in line]  # how far it is, where that is due
    assert len(said) == 1
    assert said[0].startswith(f"mccd: warning: kernel cache: {folder} may be written by other users; ")
    assert list(folder.iterdir()) == []


def test_json_is_all_there_is_on_standard_output(capsys: pytest.CaptureFixture[str]) -> None:
    say("settling on θx …")
    emit({"ok": True, "µ": "θ"}, as_json=True, text="passed")
    out, err = capsys.readouterr()
    assert json.loads(out) == {"ok": True, "µ": "θ"}
    assert err == "settling on θx …\n"


def test_text_is_printed_as_it_stands(capsys: pytest.CaptureFixture[str]) -> None:
    emit({"ok": True}, as_json=False, text="passed")
    assert capsys.readouterr() == ("passed\n", "")


def test_what_json_cannot_hold_is_reduced_to_what_it_can() -> None:
    result = Settling("θx", np.array([[0.005, np.nan], [np.inf, 1.0]]), Path("runs/a.h5"))
    assert plain(result) == {"axis": "θx", "time_s": [[0.005, None], [None, 1.0]], "file": "runs/a.h5"}
    reduced = plain({1: np.float64(0.1), "b": np.int64(3), "c": np.bool_(True), "d": (1, {"y", "x"}), "e": None})
    assert reduced == {"1": 0.1, "b": 3, "c": True, "d": [1, ["x", "y"]], "e": None}
    assert type(reduced["b"]) is int and type(reduced["c"]) is bool


def test_every_digit_of_a_number_survives(capsys: pytest.CaptureFixture[str]) -> None:
    values = np.random.default_rng(1).standard_normal(100)
    emit(values, as_json=True, text="")
    assert np.array_equal(json.loads(capsys.readouterr().out), values)


def test_what_stands_in_a_file_cannot_command_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    text = "a\x1b[2J\x07b\r\u202ec\udc80\n\td µθ"
    assert visible(text) == "a\\x1b[2J\\x07b\\r\\u202ec\\udc80\n\td µθ"
    say(text)
    emit(None, as_json=False, text=text)
    out, err = capsys.readouterr()
    assert out == err == visible(text) + "\n"


def test_columns_are_as_wide_as_their_widest_cell() -> None:
    rows = [("angle", "rad"), ("x", "m")]
    assert table(rows, heads=("channel", "unit")) == "channel  unit\nangle    rad\nx        m"
    assert table(rows) == "angle  rad\nx      m"
    assert table([]) == ""


COLOURED = """
from mccdcli.output import BAD, GOOD, emit
emit({"ok": True}, as_json=False, text="stability  ok\\nbooks  FAILED", colours={"ok": GOOD, "FAILED": BAD})
"""


@pytest.mark.parametrize(
    ("environment", "coloured"), [({}, True), ({"NO_COLOR": "1"}, False), ({"TERM": "dumb"}, False)]
)
def test_a_terminal_gets_colours_unless_it_wants_none(environment: dict[str, str], coloured: bool) -> None:
    ours, theirs = pty.openpty()
    clean = {name: value for name, value in os.environ.items() if name != "NO_COLOR"}
    command = [sys.executable, "-c", COLOURED]
    done = subprocess.Popen(command, stdout=theirs, env=clean | {"TERM": "xterm"} | environment)
    assert done.wait(timeout=60) == 0
    shown = os.read(ours, 65536).decode().replace("\r\n", "\n")
    os.close(theirs)
    os.close(ours)
    green, red, end = "\x1b[32m\x1b[1m", "\x1b[31m\x1b[1m", "\x1b[0m"
    expected = f"stability  {green}ok{end}\nbooks  {red}FAILED{end}\n"
    assert shown == (expected if coloured else "stability  ok\nbooks  FAILED\n")


def test_a_pipe_gets_no_colours() -> None:
    done = subprocess.run([sys.executable, "-c", COLOURED], capture_output=True, text=True, timeout=60)
    assert done.stdout == "stability  ok\nbooks  FAILED\n"


def test_a_person_reads_numbers_without_exponents_and_a_program_all_digits(capsys):
    rows = table([("29.6 ± 8.6e-05", "1.39e+09"), ("run 12e45678", "a-1e-05.h5")], heads=("frequency", "x"))
    emit({"x": 8.6e-05}, as_json=False, text=f"{rows}\n(+2.67e+09 %)")
    said = capsys.readouterr().out
    assert "29.6 ± 8.6·10⁻⁵  1.39·10⁹" in said and "(+2.67·10⁹ %)" in said
    assert "run 12e45678     a-1e-05.h5" in said
    emit({"x": 8.6e-05}, as_json=True, text="")
    assert json.loads(capsys.readouterr().out) == {"x": 8.6e-05}
