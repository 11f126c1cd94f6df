"""Disks that are full or read-only, and logs that another program holds: through the real commands, on real disks.

A bench at the end of a line keeps its own journal. So every segment that it played can be looked for in the logs.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from campaigns.log import read_run, verify
from tests.campaigns.serial.conftest import Serve, Served
from tests.small_disk import on_small_disk, with_read_only

ROOT = Path(__file__).parents[3]
CAMPAIGN = """schema = "mccd-campaign/1"
name = "small"
[[runs]]
name = "a"
plan = "hysteresis"
settings = { torques_nm = [0.05, 0.08] }
[[runs]]
name = "b"
plan = "sinesweep"
settings = { bands = [{ start_hz = 10.0, stop_hz = 100.0, step_hz = 10.0 }] }
"""


@pytest.fixture(autouse=True)
def own_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let `mccd` be found from any folder, and a crash file not land in anybody's home."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    path = tmp_path / "small-campaign.toml"
    path.write_text(CAMPAIGN)
    return path


def mccd(*arguments: str) -> str:
    """Return the shell command of `mccd ARGUMENTS`."""
    return " ".join([sys.executable, "-m", "mccdcli", *arguments])


def the_error(done: subprocess.CompletedProcess[str], code: int = 4) -> str:
    """Return the one line in which the command ended."""
    assert done.returncode == code, done.stderr
    lines = [line for line in done.stderr.splitlines() if "error" in line or "Traceback" in line]
    assert len(lines) == 1 and lines[0].startswith("mccd: error: "), done.stderr
    return lines[0]


def played(served: Served) -> int:
    """How many segments the bench played to their end."""
    return sum(line.startswith("done") and "upload" not in line for line in served.journal)


def is_safe(served: Served) -> bool:
    return served.state in ("idle", "fault")


def same(one: Path, other: Path) -> bool:
    with read_run(one) as a, read_run(other) as b:
        return a.segments == b.segments and all(a.read(n).tobytes() == b.read(n).tobytes() for n in b.channels)


def test_a_disk_that_is_too_small_is_told_before_the_bench_moves(tmp_path: Path, serve: Serve, campaign: Path) -> None:
    served = serve()
    done = on_small_disk(
        tmp_path / "disk", "2m", mccd("campaign", "run", str(campaign), "--out", "c", "--bench", served.address)
    )
    assert "MB free and the logs take" in the_error(done)
    assert played(served) == 0 and is_safe(served)
    assert list((tmp_path / "disk").rglob("*.h5")) == []


# From a disk that is full to where the header fits: a log with a header alone has about 16 kB.
@pytest.mark.parametrize("free_kb", [0, 4, 12, 24])
def test_a_disk_without_room_for_a_header_leaves_nothing_behind(tmp_path: Path, free_kb: int) -> None:
    (tmp_path / "map.toml").write_text(
        '[log]\ntest = "t"\nsource = "a.csv"\nsample_rate_hz = 10.0\n'
        '[channels.x]\nselect = "x"\nunit = "m"\nrole = "output"\n'
    )
    (tmp_path / "a.csv").write_text("x\n1\n2\n3\n")
    fill = f"head -c $((1048576 - {1024 * free_kb})) /dev/zero >ballast; "
    done = on_small_disk(tmp_path / "disk", "1m", fill + mccd("import", str(tmp_path / "map.toml"), "-o", "run.h5"))
    assert "cannot make the log run.h5: No space left on device" in the_error(done)
    assert [path.name for path in (tmp_path / "disk").iterdir()] == ["ballast"]


def test_a_copy_that_does_not_fit_leaves_nothing_behind(tmp_path: Path) -> None:
    """What was measured is kept however a run ends; an import or a recovered log can be made again."""
    (tmp_path / "map.toml").write_text(
        '[log]\ntest = "t"\nsource = "a.csv"\nsample_rate_hz = 10.0\n'
        '[channels.x]\nselect = "x"\nunit = "m"\nrole = "output"\n'
    )
    values = np.random.default_rng(0).standard_normal(100_000).tolist()
    (tmp_path / "a.csv").write_text("x\n" + "\n".join(map(repr, values)))
    whole = tmp_path / "whole.h5"
    importing = ("import", str(tmp_path / "map.toml"), "-o")
    subprocess.run(mccd(*importing, str(whole)), shell=True, check=True, capture_output=True)
    for k, arguments in enumerate(((*importing, "run.h5"), ("log", "recover", str(whole), "-o", "run.h5"))):
        disk = tmp_path / f"disk{k}"
        assert "No space left on device" in the_error(on_small_disk(disk, "400k", mccd(*arguments)))
        assert list(disk.iterdir()) == [], arguments


FILL_WHEN_IT_GROWS = """
{run} & host=$!
until [ -e c/b.h5 ] && [ "$(stat -c %s c/b.h5)" -gt 1000000 ]; do kill -0 $host || exit 1; sleep 0.01; done
dd if=/dev/zero of=ballast bs=4k 2>/dev/null
wait $host; code=$?
rm ballast
exit $code
"""


def test_a_disk_that_others_fill_costs_nothing_that_was_measured(tmp_path: Path, serve: Serve, campaign: Path) -> None:
    served, disk = serve(speed=5.0), tmp_path / "disk"
    run = mccd("campaign", "run", str(campaign), "--out", "c", "--bench", served.address)
    message = the_error(on_small_disk(disk, "80m", FILL_WHEN_IT_GROWS.format(run=run)))
    assert "cannot write the log c/b.h5: No space left on device" in message
    assert is_safe(served)
    with read_run(disk / "c" / "a.h5") as first, read_run(disk / "c" / "b.h5") as second:
        assert (first.status, second.status) == ("complete", "failed")
        assert "No space left on device" in second.header.status_reason
        assert 0 < len(second.segments) < 10
        # every segment that the bench played is in a log, whole: the room for it was taken before it was played
        assert len(first.segments) + len(second.segments) == played(served)
        assert second.segments[-1].stop == second.rows
    assert all(verify(disk / "c" / name).ok for name in ("a.h5", "b.h5"))


def test_a_campaign_that_a_full_disk_ended_is_resumed_to_the_same_data(
    tmp_path: Path, model_path: str, campaign: Path
) -> None:
    run = mccd("campaign", "run", str(campaign), "--bench", f"sim:{model_path}", "--seed", "4", "--out")
    # The disk fills while the first run is made, so the second, or what is left of the first, finds no room. The
    # campaign is held meanwhile: a simulated one may be done before a slow disk is full.
    begun = f"{run} c & host=$!; until [ -e c/a.h5 ]; do kill -0 $host || exit 1; sleep 0.01; done; "
    filled = 'kill -STOP $host; dd if=/dev/zero of=ballast bs=4k 2>"$1"; kill -CONT $host; '
    ended = f'wait $host; echo "first: $?"; rm ballast; {run} c --resume && {run} whole'
    disk = tmp_path / "disk"
    done = on_small_disk(disk, "150m", begun + filled + ended, os.devnull)
    assert done.returncode == 0, done.stderr
    assert "first: 4" in done.stdout
    assert all(same(disk / "c" / name, disk / "whole" / name) for name in ("a.h5", "b.h5"))


def test_a_read_only_folder_is_told_before_the_bench_moves(tmp_path: Path, serve: Serve, campaign: Path) -> None:
    served, folder = serve(), tmp_path / "folder"
    folder.mkdir()
    for command in (
        ["campaign", "run", str(campaign), "--out", "c", "--bench", served.address],
        ["hysteresis", "-o", "run.h5", "--bench", served.address],
    ):
        assert "Read-only file system; check the folder" in the_error(with_read_only(folder, mccd(*command)))
    assert played(served) == 0 and is_safe(served)
    assert list(folder.iterdir()) == []


def test_a_folder_that_became_read_only_keeps_its_logs(tmp_path: Path, model_path: str, campaign: Path) -> None:
    folder = tmp_path / "c"
    run = mccd("campaign", "run", str(campaign), "--bench", f"sim:{model_path}", "--out", str(folder))
    subprocess.run(run, shell=True, check=True, capture_output=True, timeout=120)
    (folder / "b.h5").unlink()  # so that a resumed campaign has something to do
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert "Read-only file system" in the_error(with_read_only(folder, f"{run} --resume"))
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize("mode", ["r+", "a"])
def test_a_log_that_another_program_writes_is_neither_kept_nor_moved(
    tmp_path: Path, serve: Serve, model_path: str, campaign: Path, mode: str
) -> None:
    served, folder = serve(), tmp_path / "c"
    run = mccd("campaign", "run", str(campaign), "--bench", served.address, "--out", str(folder))
    subprocess.run(run, shell=True, check=True, capture_output=True, timeout=120)
    (folder / "b.h5").unlink()
    before, count = sorted(folder.iterdir()), played(served)
    with h5py.File(folder / "a.h5", mode):
        done = subprocess.run(f"{run} --resume", shell=True, capture_output=True, text=True, timeout=120)
    assert "a.h5 is open for writing in another program; close it there" in the_error(done)
    assert sorted(folder.iterdir()) == before
    assert played(served) == count and is_safe(served)


def test_a_log_that_is_being_recorded_is_nobody_elses_to_write(tmp_path: Path, model_path: str) -> None:
    """The other way round: HDF5 refuses a second writer while ours has the lock."""
    from campaigns.log import Channel, LogWriter

    with LogWriter.create(tmp_path / "a.h5", [Channel("x", "m", "output", "z", 1e4)], test="t", bench={}) as log:
        log.append({"x": [1.0]})
        second = "import h5py, sys\nh5py.File(sys.argv[1], 'r+')"
        done = subprocess.run(
            [sys.executable, "-c", second, str(tmp_path / "a.h5")], capture_output=True, text=True, timeout=60
        )
        assert done.returncode != 0 and "unable to lock file" in done.stderr
