"""`mccd log show | verify | recover` against files whose contents the test has written itself."""

from __future__ import annotations

import json
import os
from pathlib import Path

import h5py
import numpy as np
import pytest

from campaigns.log import Channel, LogWriter, read_run
from mccdcli.main import main

RATE_HZ = 10_000.0
ANGLE_RAD = np.linspace(0.0, 1e-3, 1000)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Return a finished log of two channels and two segments."""
    path = tmp_path / "run.h5"
    channels = [
        Channel("torque", "N m", "input", "theta_x", RATE_HZ),
        Channel("angle", "rad", "output", "theta_x", RATE_HZ),
    ]
    bench = {"kind": "sim", "name": "θ-mirror \x1b[31m"}
    with LogWriter.create(path, channels, test="chop", bench=bench, seed=7) as log:
        for label, part in (("sweep", slice(0, 600)), ("held-out", slice(600, 1000))):
            with log.segment(label, {}):
                log.append({"torque": np.zeros(ANGLE_RAD[part].size), "angle": ANGLE_RAD[part]})
    return path


def test_show_as_json_is_what_was_written(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["log", "show", str(run), "--json"]) == 0
    out, err = capsys.readouterr()
    shown = json.loads(out)
    assert err == ""
    expected = {"file": str(run), "test": "chop", "status": "complete", "seed": 7, "rows": 1000}
    assert {key: shown[key] for key in expected} == expected
    assert shown["sample_rate_hz"] == RATE_HZ
    assert [(c["name"], c["unit"], c["role"]) for c in shown["channels"]] == [
        ("torque", "N m", "input"),
        ("angle", "rad", "output"),
    ]
    assert [(s["label"], s["start"], s["stop"], s["held_out"]) for s in shown["segments"]] == [
        ("sweep", 0, 600, False),
        ("held-out", 600, 1000, True),
    ]


def test_show_for_a_person_keeps_control_characters_from_the_terminal(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["log", "show", str(run)]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["length", "1000", "samples", "at", "10000", "Hz,", "0.1", "s"] in lines
    size = [f"{value:.6g}" for value in (0.0, 1e-3, ANGLE_RAD.std())]
    assert ["angle", "rad", "output", "theta_x", *size] in lines
    assert ["held-out", "600", "1000"] in lines
    assert ["bench", "kind", "sim,", "name", "θ-mirror", r"\x1b[31m"] in lines


def test_show_works_where_the_terminal_has_no_such_letters(run: Path, mccd) -> None:
    done = mccd("log", "show", str(run), PYTHONIOENCODING="latin-1")
    assert done.returncode == 0, done.stderr
    assert r"\u03b8-mirror" in done.stdout


def test_a_log_as_written_is_verified(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["log", "verify", str(run), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["ok"] is True
    assert [report["ok"] for report in shown["runs"]] == [True]
    assert all(check["ok"] for check in shown["runs"][0]["checks"])


def test_one_flipped_bit_in_one_of_two_logs_fails_the_verification(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    damaged = run.with_name("damaged.h5")
    contents = bytearray(run.read_bytes())
    contents[len(contents) // 2] ^= 1
    damaged.write_bytes(contents)
    sidecar = run.with_name("run.h5.sha256").read_text().replace("run.h5", "damaged.h5")
    damaged.with_name("damaged.h5.sha256").write_text(sidecar)
    assert main(["log", "verify", str(run), str(damaged)]) == 1
    lines = capsys.readouterr().out.splitlines()
    failed = [line for line in lines if "FAILED" in line]
    assert failed
    assert all(line.startswith(str(damaged)) for line in failed)


def test_a_crashed_log_is_recovered_beside_it(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with h5py.File(run, "r+") as file:
        file.attrs["status"] = "running"
    assert main(["log", "recover", str(run), "--json"]) == 0
    saved = json.loads(capsys.readouterr().out)
    assert saved["path"] == str(run.with_name("run.recovered.h5"))
    assert (saved["rows"], saved["committed_rows"]) == (1000, 1000)
    with read_run(saved["path"]) as log:
        assert log.status == "crashed"
        assert np.array_equal(log.read("angle"), ANGLE_RAD)


def test_recovery_overwrites_nothing(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = run.read_bytes()
    assert main(["log", "recover", str(run), "--out", str(run)]) == 2
    err = capsys.readouterr().err
    assert err.startswith("mccd: error: ") and err.count("\n") == 1
    assert run.read_bytes() == before


@pytest.mark.parametrize("command", ["show", "verify", "recover"])
def test_a_file_that_is_not_there_is_wrong_usage(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["log", command, str(tmp_path / "none.h5")]) == 2
    assert "does not exist" in capsys.readouterr().err


def test_a_file_that_is_no_log_is_a_data_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    foreign = tmp_path / "foreign.h5"
    foreign.write_text("time,angle\n0,1\n")
    assert main(["log", "show", str(foreign)]) == 4
    err = capsys.readouterr().err
    assert err.startswith("mccd: error: ") and err.count("\n") == 1
    assert str(foreign) in err


@pytest.mark.parametrize("command", ["show", "verify"])
def test_a_pipe_is_not_waited_for(command: str, tmp_path: Path, mccd) -> None:
    os.mkfifo(tmp_path / "run.h5")
    done = mccd("log", command, str(tmp_path / "run.h5"))
    assert done.returncode == 4 and ("no ordinary file" in done.stderr or "is not a file" in done.stderr)
