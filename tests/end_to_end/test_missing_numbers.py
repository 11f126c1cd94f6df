"""Readings that are no numbers, as the serial protocol allows: left out and told, or refused in a sentence."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from campaigns.facts import measured_segments
from campaigns.log import Channel, LogWriter, read_run
from mccdcli.main import main

RATE_HZ, ROWS, PERIOD = 1000.0, 4096, 1024
MODE_HZ, DAMPING = 40.0, 0.03


def one(u: np.ndarray, y: np.ndarray) -> None:
    y[700] = np.nan


def held_out(u: np.ndarray, y: np.ndarray) -> None:
    y[3000] = np.nan


def infinite(u: np.ndarray, y: np.ndarray) -> None:
    y[700] = np.inf


def of_the_input(u: np.ndarray, y: np.ndarray) -> None:
    u[500:510] = np.nan


def every(u: np.ndarray, y: np.ndarray) -> None:
    y[:] = np.nan


def too_many(u: np.ndarray, y: np.ndarray) -> None:
    y[::50] = np.nan


def log_with(path: Path, lose, *, periodic: bool) -> Path:
    rng = np.random.default_rng(1)
    u = np.tile(rng.normal(size=PERIOD), ROWS // PERIOD) if periodic else rng.normal(size=ROWS)
    omega = 2.0 * np.pi * MODE_HZ
    num, den, _ = signal.cont2discrete(([1e-3 * omega**2], [1.0, 2.0 * DAMPING * omega, omega**2]), 1.0 / RATE_HZ)
    y = signal.lfilter(num.ravel(), den, u) + 1e-6 * rng.normal(size=ROWS)
    lose(u, y)
    channels = [Channel("u", "N m", "input", "x", RATE_HZ), Channel("y", "rad", "output", "x", RATE_HZ)]
    with LogWriter.create(path, channels, test="free-run", bench={"kind": "x"}) as log:
        for label, part in (("fit", slice(0, ROWS // 2)), ("held-out", slice(ROWS // 2, ROWS))):
            with log.segment(label, {"period_samples": PERIOD} if periodic else {}):
                log.append({"u": u[part], "y": y[part]})
    return path


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("periodic", [True, False], ids=["periodic", "free"])
@pytest.mark.parametrize("lose", [one, held_out, infinite, of_the_input])
def test_rows_without_numbers_are_told_and_left_out_of_an_identification(here, capsys, lose, periodic):
    log_with(here / "a.h5", lose, periodic=periodic)
    assert main(["identify", "--log", "a.h5", "--modes", "1", "-o", "n.toml", "--json"]) == 0
    said = capsys.readouterr()
    found = json.loads(said.out)["identification"]
    (mode,) = found["modes"]
    # three periods of noise of a thousandth of the motion decide a mode of 3 % damping to far better than this
    assert mode["frequency_hz"] == pytest.approx(MODE_HZ, rel=1e-3)
    told = [remark for remark in found["remarks"] if "holds no number" in remark]
    assert len(told) == 1 and "left out" in told[0]


@pytest.mark.parametrize("lose", [every, too_many])
@pytest.mark.parametrize("periodic", [True, False], ids=["periodic", "free"])
def test_a_log_without_enough_numbers_is_refused_with_their_place(here, capsys, lose, periodic):
    log_with(here / "a.h5", lose, periodic=periodic)
    assert main(["identify", "--log", "a.h5", "-o", "n.toml"]) == 4
    said = capsys.readouterr().err
    assert "y holds no number in" in said and 'of "fit", first in sample 0' in said and said.count("\n") <= 2


def test_what_is_left_of_a_segment_holds_numbers_alone(here):
    with read_run(log_with(here / "a.h5", one, periodic=True)) as run:
        parts = measured_segments(run)
        assert [(part.label, part.start, part.stop) for part in parts] == [
            ("fit", 0, 700),
            ("fit", 701, 2048),
            ("held-out", 2048, 4096),
        ]
        assert "period_samples" not in parts[0].settings and "period_samples" in parts[2].settings


@pytest.mark.parametrize("lose", [one, of_the_input, infinite, every])
def test_logs_with_such_rows_are_watched_drawn_and_summarised(here, capsys, lose):
    log_with(here / "good.h5", lambda _u, _y: None, periodic=False)
    assert main(["identify", "--log", "good.h5", "--modes", "1", "-o", "n.toml"]) == 0
    log_with(here / "a.h5", lose, periodic=False)
    for command in (
        ["watch", "a.h5", "--once"],
        ["watch", "a.h5"],
        ["watch", "a.h5", "--once", "--model", "n.toml"],
        ["log", "plot", "a.h5"],
        ["log", "plot", "a.h5", "-o", "a.svg"],
        ["log", "summary", "a.h5"],
        ["log", "check", "a.h5"],
    ):
        assert main(command) == 0, command
    capsys.readouterr()
    assert main(["watch", "a.h5", "--once", "--model", "n.toml", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    (reading,), (misfit,) = found["readings"], found["misfits"]
    if lose is every:
        assert reading["last"] is None and reading["low"] is None and misfit["residual_rms"] is None
    else:  # the rows of noise of 1e-6 are seen, and what is not known counts in nothing
        assert reading["high"] > 1e-4 and misfit["residual_rms"] < 0.1 * misfit["output_rms"]
    assert main(["diagnose", "a.h5", "--model", "n.toml", "-o", "d"]) == 4
    assert "not finite" in capsys.readouterr().err
