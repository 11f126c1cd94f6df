"""What a user gets wrong ends in one line with file, value, limit and fix, and leaves everything as it was."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import h5py
import pytest

from tests import running

MAP = """[log]
test = "free-run"
source = "{source}"
{time}
[channels.torque]
select = "{select}"
unit = "{unit}"
role = "input"
dof = "theta_x"
[channels.angle]
select = "ax"
unit = "mrad"
role = "output"
dof = "theta_x"
{more}
"""
GOOD = {"source": "data.csv", "time": "sample_rate_hz = 1000.0", "select": "tx", "unit": "mN m", "more": ""}
ROWS = [f"{k * 1e-3:.6f},{(k * k) % 7},{k % 5}" for k in range(100)]

Mccd = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def mccd(tmp_path: Path) -> Mccd:
    """Return a function that runs `mccd ARGUMENTS` in a folder with data to import."""
    (tmp_path / "data.csv").write_text("\n".join(["t,tx,ax", *ROWS]))

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        home = str(tmp_path / "home")
        return running.mccd(*arguments, cwd=tmp_path, env={"HOME": home, "XDG_STATE_HOME": home})

    return run


def refused(done: subprocess.CompletedProcess[str], code: int, *said: str) -> None:
    """Assert that a command ended with `code` and one line on standard error that says all of `said`."""
    assert done.returncode == code, done.stderr
    assert done.stdout == ""
    lines = done.stderr.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("mccd: error: ")
    for words in said:
        assert words in lines[0]


@pytest.mark.parametrize(
    ("change", "code", "said"),
    [
        ({"unit": "furlong"}, 2, ("map.toml", "torque", "'furlong'", "accepted are", "mN m")),
        ({"select": "tz"}, 4, ("map.toml", "data.csv", "'tz'", "it has t, tx, ax")),
        ({"source": "nan.csv"}, 4, ("map.toml", "torque", "nan at sample 39", "repair them")),
        (
            {"source": "jitter.csv", "time": 'time = "t"'},
            4,
            ("map.toml", "not uniform", "0.0017 s", "limit: 1 %", "resample"),
        ),
        ({"more": 'colour = "red"'}, 2, ("map.toml", "'colour'", "known are select, unit")),
    ],
    ids=["unit", "channel", "nan", "time", "field"],
)
def test_a_map_that_does_not_fit_its_data_writes_nothing(tmp_path, mccd, change, code, said):
    rows = list(ROWS)
    rows[39] = f"{39e-3:.6f},nan,0.1"
    (tmp_path / "nan.csv").write_text("\n".join(["t,tx,ax", *rows]))
    rows[39] = "0.039700,0.2,0.1"
    (tmp_path / "jitter.csv").write_text("\n".join(["t,tx,ax", *rows]))
    (tmp_path / "map.toml").write_text(MAP.format(**{**GOOD, **change}))
    refused(mccd("import", "map.toml", "-o", "run.h5"), code, *said)
    assert not (tmp_path / "run.h5").exists()


def test_an_existing_log_is_never_overwritten(tmp_path, mccd):
    (tmp_path / "map.toml").write_text(MAP.format(**GOOD))
    assert mccd("import", "map.toml", "-o", "run.h5").returncode == 0
    before = (tmp_path / "run.h5").read_bytes()
    for command in (("import", "map.toml"), ("settle", "--cycles", "3"), ("simulate",)):
        refused(mccd(*command, "-o", "run.h5"), 2, "run.h5", "choose another")
    assert (tmp_path / "run.h5").read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            ("settle", "--alpha", "90", "--strategy", "repetitive", "--set", "tuning={feedback_factor=40.0}"),
            ("theta_y", "design-4th-order", "unstable", "the limit is 1", "lower the gain"),
        ),
        (("chop", "--form", "0:+12"), ("reference of axis 1", "0.012", "0.01", "stay below")),
        (
            ("settle", "--alpha", "90", "--set", "tuning={move_s=0.001}"),
            ("feed-forward", "55.4 A", "9 A", "smaller or slower"),
        ),
        (("endstops", "--set", "current_a=10"), ("10 A", "9 A", "smaller or slower")),
        (("chop", "--set", "colour=red"), ("plan chop", "`colour`", "its settings are alpha_deg")),
    ],
    ids=["unstable", "end stops", "step too fast", "current", "setting"],
)
def test_a_test_that_a_bench_cannot_do_is_not_begun(tmp_path, mccd, arguments, said):
    refused(mccd(*arguments, "-o", "run.h5"), 2, *said)
    assert not (tmp_path / "run.h5").exists()


@pytest.mark.parametrize("kind", ["model", "campaign"])
def test_an_unknown_field_of_a_model_or_a_campaign_is_named(tmp_path, mccd, kind):
    (tmp_path / "a.toml").write_text(f'schema = "mccd-{kind}/1"\nname = "a"\ncolour = "red"\n')
    command = ("simulate", "--model") if kind == "model" else ("campaign", "run")
    refused(mccd(*command, "a.toml", "-o", "out"), 2, "a.toml", "`colour`")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("kind", "said"), [("text", "not an HDF5"), ("broken", "cannot open"), ("foreign", "mccd-log/1")]
)
def test_a_file_that_is_no_log_is_refused_and_left_alone(tmp_path, mccd, kind, said):
    path = tmp_path / "a.h5"
    if kind == "foreign":
        with h5py.File(path, "w") as file:
            file["x"] = [1.0, 2.0]
    else:
        path.write_bytes(b"hello" if kind == "text" else b"\x89HDF\r\n\x1a\n" + b"x" * 500)
    before = path.read_bytes()
    refused(mccd("log", "show", "a.h5"), 4, "a.h5", said)
    refused(mccd("identify", "--log", "a.h5", "-o", "m.toml"), 4, "a.h5", said)
    assert path.read_bytes() == before
    assert not (tmp_path / "m.toml").exists()
