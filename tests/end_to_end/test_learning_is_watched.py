"""Learning on benches that a controller was not made for: stopped in time, told why, the log kept; by the commands.

The logs are judged here on their own: readings against the commanded positions, and dissipation from recorded currents.
"""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from campaigns.log import read_run
from mccdcli.main import main
from sim_backend.model import dump_model
from tests.designed import designed
from tests.shifted_bench import shifted_bench

pytestmark = pytest.mark.slow

PERIOD, DWELL, STEP, LEVEL_RAD = 2000, 1000, 50, 8.5e-3
OFF_RAD, MOST_W = 50e-6, 1.0

BENCHES: dict[str, dict[str, Any]] = {
    "modes -1 %": {"frequency": -0.01},
    "490 Hz -0.7 %": {"frequency": -0.007, "only": "490"},
    "2 samples late": {"delay_samples": 2.0},
    "amplifier at 1 kHz": {"amplifier_hz": 1000.0},
    "all at once": {"frequency": -0.01, "delay_samples": 1.0, "amplifier_hz": 1000.0},
    # beyond what a design expects
    "modes -3 %": {"frequency": -0.03},
    "490 Hz +4 %": {"frequency": 0.04, "only": "490"},
}


@pytest.fixture(scope="module")
def controller() -> Path:
    """The design on the bundled linear model and the noise of the bench as built."""
    return designed() / "design" / "controller.toml"


def settled(here: Path, controller: Path, alpha: float, kind: str = "sim", **shift: Any) -> tuple[int, Path]:
    """Return the exit code and the log of a fast chop on a bench that has changed since it was designed for."""
    (here / "as-built.toml").write_text(dump_model(shifted_bench(**shift)), encoding="utf-8")
    log = here / "settle.h5"
    bench = f"{kind}:{here / 'as-built.toml'}"
    given = ["--bench", bench, "--controller", str(controller), "--alpha", f"{alpha:g}", "--out", str(log)]
    return main(["settle", "--strategy", "designed", *given]), log


def cycles_of(log: Path, axis: str) -> list[tuple[bool, float]]:
    """Return of every recorded cycle whether it strays after its steps, and its dissipation in W."""
    found = []
    with read_run(log) as run:
        for one in run.segments:
            for start in range(one.start, one.stop - PERIOD + 1, PERIOD):
                rows = slice(start, start + PERIOD)
                angle = run.read(axis, rows.start, rows.stop).reshape(2, DWELL)[:, STEP:]
                off = np.abs(angle - np.array([[LEVEL_RAD], [0.0]])).max() > OFF_RAD
                currents = [run.read(f"current_a{i}", rows.start, rows.stop) for i in (1, 2, 3)]
                found.append((bool(off), float(sum(np.mean((5.7 / 7.9 * i) ** 2) for i in currents))))
    return found


def longest(flags: list[bool]) -> int:
    return max((len(list(same)) for flag, same in groupby(flags) if flag), default=0)


@pytest.mark.parametrize("alpha", [0.0, 90.0])
@pytest.mark.parametrize("shift", BENCHES.values(), ids=BENCHES)
def test_nothing_goes_on_for_more_than_three_cycles(controller, tmp_path, capsys, shift, alpha):
    code, log = settled(tmp_path, controller, alpha, **shift)
    said = capsys.readouterr().err
    cycles = cycles_of(log, "theta_x" if alpha == 0.0 else "theta_y")
    assert longest([off for off, _ in cycles]) <= 3
    assert longest([power > MOST_W for _, power in cycles]) <= 3
    with read_run(log) as run:
        if run.status == "complete":  # what the design expects of a bench is learned
            assert code in (0, 1) and not any(off or power > MOST_W for off, power in cycles[-25:])
            return
        assert code == 1 and run.status == "failed"
        assert "limit is" in run.header.status_reason
        # what was recorded of the last cycle that was judged is there, and what came after it
        assert run.segments[-1].stop == run.rows and len(cycles) >= 2
        fell_back = run.segments[-1].label == "fallback"
    assert "mccd: error: cycle" in said and "limit is" in said and "design anew" in said
    assert ("under feedback" in said) == fell_back


def test_theta_x_of_the_bench_with_its_mode_elsewhere_is_stopped_and_falls_back(controller, tmp_path, capsys):
    code, log = settled(tmp_path, controller, 0.0, **BENCHES["490 Hz +4 %"])
    assert code == 1 and "theta_x" in capsys.readouterr().err
    cycles = cycles_of(log, "theta_x")
    assert len(cycles) < 20 and cycles[-1][1] < MOST_W
    with read_run(log) as run:
        assert run.segments[-1].label == "fallback"
        end = run.read("theta_x")[-DWELL // 5 :]
    # within a cycle it is back where it belongs, in the last fifth of its last dwell
    assert np.abs(end).max() < OFF_RAD


def test_the_bench_as_built_is_not_stopped(controller, tmp_path):
    code, log = settled(tmp_path, controller, 0.0)
    assert code == 0
    with read_run(log) as run:
        assert run.status == "complete"


@pytest.mark.parametrize("alpha", [0.0, 90.0])
def test_the_papers_learning_is_not_stopped_on_the_bench_as_built(tmp_path, alpha):
    log = tmp_path / "settle.h5"
    assert main(["settle", "--strategy", "repetitive", "--alpha", f"{alpha:g}", "--out", str(log)]) in (0, 1)
    with read_run(log) as run:
        assert run.status == "complete"


def test_a_bench_behind_a_line_is_watched_alike(controller, tmp_path, capsys):
    code, log = settled(tmp_path, controller, 0.0, kind="emulator", **BENCHES["modes -3 %"])
    assert code == 1 and "limit is" in capsys.readouterr().err
    cycles = cycles_of(log, "theta_x")
    assert longest([off for off, _ in cycles]) <= 3 and longest([power > MOST_W for _, power in cycles]) <= 3


def test_a_chop_that_records_readings_alone_is_watched_too(controller, tmp_path, capsys):
    """The five minutes of the thermal test leave commands out of the log; the watch sees them all the same."""
    (tmp_path / "as-built.toml").write_text(dump_model(shifted_bench(-0.03)), encoding="utf-8")
    settings = ["strategy='designed'", f"controller='{controller}'", "alpha_deg=0.0", "cycles=20"]
    given = [part for text in settings for part in ("--set", text)]
    bench = f"sim:{tmp_path / 'as-built.toml'}"
    assert main(["thermal", "--no-sweeps", "--bench", bench, "--out", str(tmp_path / "t"), *given]) == 1
    assert "cycle" in capsys.readouterr().err
    with read_run(tmp_path / "t" / "thermal.h5") as run:
        assert run.status == "failed" and "command_theta_x" not in run.channels
