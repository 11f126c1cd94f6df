"""Progress: a bar on a terminal, lines elsewhere, nothing on standard output."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys

import pytest

from mccdcli.progress import LINE_PERIOD_S, _forward, _lines, progress

WORK = """
from mccdcli.progress import progress
with progress("sine sweep [x]") as report:
    for k in range(11):
        report(k, 10, "10 Hz")
print("rich" in __import__("sys").modules)
"""


def on_a_terminal(**environment: str) -> tuple[str, str]:
    """Run WORK with a terminal as standard error; return its standard output and what the terminal got."""
    ours, theirs = pty.openpty()
    clean = {name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "FORCE_COLOR")}
    try:
        done = subprocess.run(
            [sys.executable, "-c", WORK],
            stdout=subprocess.PIPE,
            stderr=theirs,
            text=True,
            timeout=60,
            env=clean | {"TERM": "xterm-256color", "COLUMNS": "100"} | environment,
        )
        os.close(theirs)
        shown = b""
        try:
            while part := os.read(ours, 65536):
                shown += part
        except OSError:  # Linux reports the end of a closed pty as an error
            pass
    finally:
        os.close(ours)
    return done.stdout, shown.decode()


COLOUR = re.compile(r"\x1b\[[\d;]*(?:3[0-8]|9[0-7])[\d;]*m")


def test_a_terminal_gets_a_bar_in_colour() -> None:
    out, shown = on_a_terminal()
    assert out == "True\n"
    assert "sine sweep [x] 10 Hz" in re.sub(r"\x1b\[[\d;?]*\w", "", shown)
    assert "100 %" in shown
    assert COLOUR.search(shown)


def test_no_color_is_honoured() -> None:
    _, shown = on_a_terminal(NO_COLOR="1")
    assert "100 %" in shown
    assert not COLOUR.search(shown)


def test_a_dumb_terminal_gets_no_control_sequence() -> None:
    out, shown = on_a_terminal(TERM="dumb")
    assert out == "False\n"
    assert "\x1b" not in shown


def test_no_terminal_no_rich_and_nothing_for_short_work() -> None:
    done = subprocess.run([sys.executable, "-c", WORK], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.stderr) == ("False\n", "")


def test_long_work_gets_a_line_now_and_then_with_the_time_left(capsys: pytest.CaptureFixture[str]) -> None:
    now_s = 0.0
    report = _lines("sweep", clock=lambda: now_s)
    for k in range(1, 21):  # one second a step: 20 s of work
        now_s = float(k)
        report(k, 20, f"{k} Hz")
    out, err = capsys.readouterr()
    assert out == ""
    assert LINE_PERIOD_S == 5.0
    assert err.splitlines() == [
        "sweep: 25 % (15 s left) 5 Hz",
        "sweep: 50 % (10 s left) 10 Hz",
        "sweep: 75 % (5 s left) 15 Hz",
        "sweep: 100 % (0 s left) 20 Hz",
    ]


def test_a_search_that_may_end_at_any_step_tells_no_time(capsys: pytest.CaptureFixture[str]) -> None:
    now_s = 0.0
    report = _lines("fit", clock=lambda: now_s, timed=False)
    for k in range(1, 11):
        now_s = float(k)
        report(k, 20, "step")
    assert capsys.readouterr().err.splitlines() == ["fit: 25 % step", "fit: 50 % step"]


def test_the_extent_of_the_work_may_be_unknown_at_first(capsys: pytest.CaptureFixture[str]) -> None:
    now_s = 0.0
    report = _lines("sweep", clock=lambda: now_s)
    now_s = 60.0
    report(0, 0, "")
    report(0, 4, "")
    assert capsys.readouterr().err == "sweep: 0 %\n"


def test_an_error_inside_the_work_comes_out_as_it_is() -> None:
    with pytest.raises(ZeroDivisionError), progress("sweep"):
        raise ZeroDivisionError


def test_progress_never_goes_back_and_tells_no_time_before_it_knows_one(capsys: pytest.CaptureFixture[str]) -> None:
    now_s = 0.0
    report = _forward(_lines("fit", clock=lambda: now_s))
    for share, step in ((0.01, "first"), (0.04, "first"), (0.6, "second"), (0.2, "again"), (0.7, "again")):
        now_s += 2 * LINE_PERIOD_S
        report(share * 8.0, 8.0, step)
    assert capsys.readouterr().err.splitlines() == [
        "fit: 1 % first",
        "fit: 4 % first",
        "fit: 60 % second",
        "fit: 60 % again",
        "fit: 70 % again",
    ]
