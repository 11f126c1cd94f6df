"""`mccd log list` and `--note`: folders of sound, foreign, damaged and hostile files, by real processes."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import h5py
import pytest

from campaigns.log import Channel, LogWriter, read_run, recover, sidecar_of
from campaigns.log.limits import MAX_NOTE_CHARS
from mccdcli.main import main
from sim_backend.errors import ConfigError
from tests.running import MCCD, REAL, mccd

CHANNELS = (Channel("torque", "N m", "input", "theta_x", 1e3), Channel("angle", "rad", "output", "theta_x", 1e3))


def write(path: Path, test: str, started: str, *, bench: str = "mirror", note: str = "", status: str = "") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    identity = {"kind": "sim", "name": bench}
    with LogWriter.create(path, CHANNELS, test=test, bench=identity, started_utc=started, note=note) as log:
        log.append({"torque": [0.0, 1.0], "angle": [0.0, 0.1]})
        if status:
            log.set_status(status, "as told")
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder of three logs, in an order that is neither that of names nor that of folders."""
    write(tmp_path / "a.h5", "chop", "2026-03-02T08:00:00+01:00", note="after the coil was changed")
    write(tmp_path / "b" / "c.h5", "sinesweep", "2026-03-01T12:00:00+00:00", bench="twin", status="aborted")
    write(tmp_path / "z.h5", "chop", "2026-03-02T06:30:00+00:00")
    return tmp_path


def listed(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[dict[str, object]]:
    assert main(["log", "list", *arguments, "--json"]) == 0
    logs: list[dict[str, object]] = json.loads(capsys.readouterr().out)["logs"]
    return logs


def names(logs: list[dict[str, object]]) -> list[str]:
    return [Path(str(one["path"])).name for one in logs]


def test_logs_stand_in_the_order_of_their_starts(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["log", "list", str(folder)]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.split() == ["log", "test", "bench", "started", "(UTC)", "status", "note"]
    assert [line.split() for line in lines] == [
        ["b/c.h5", "sinesweep", "sim", "twin", "2026-03-01", "12:00:00", "aborted"],
        ["z.h5", "chop", "sim", "mirror", "2026-03-02", "06:30:00", "complete"],
        "a.h5 chop sim mirror 2026-03-02 07:00:00 complete after the coil was changed".split(),
    ]


@pytest.mark.parametrize(
    ("filters", "expected"),
    [
        (["--test", "CHOP"], ["z.h5", "a.h5"]),
        (["--bench", "twin"], ["c.h5"]),
        (["--status", "aborted"], ["c.h5"]),
        (["--note", "Coil"], ["a.h5"]),
        (["--since", "2026-03-02"], ["z.h5", "a.h5"]),
        (["--since", "2026-03-02T07:30:00+01:00"], ["z.h5", "a.h5"]),
        (["--since", "2026-03-02T07:00:00"], ["a.h5"]),
        (["--test", "chop", "--since", "2026-03-02T06:45:00"], ["a.h5"]),
        (["--status", "failed"], []),
    ],
)
def test_filters_leave_what_is_asked_for(
    filters: list[str], expected: list[str], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert names(listed(capsys, str(folder), *filters)) == expected


def test_every_file_that_is_no_sound_log_is_a_line_that_says_so(folder: Path) -> None:
    (folder / "text.h5").write_text("nothing of the kind")
    with h5py.File(folder / "foreign.h5", "w") as file:
        file["data"] = [1.0, 2.0]
    whole = write(folder / "cut.h5", "chop", "2026-03-02T06:30:00+00:00").read_bytes()
    (folder / "cut.h5").write_bytes(whole[: len(whole) // 3])
    with h5py.File(write(folder / "long.h5", "chop", "2026-03-02T06:30:00+00:00"), "r+") as file:
        file.attrs["note"] = "x" * (MAX_NOTE_CHARS + 1)
    for name, started in (("first.h5", "0001-01-01T00:00:00+14:00"), ("last.h5", "9999-12-31T23:59:59-14:00")):
        with h5py.File(write(folder / name, "chop", "2026-03-02T06:30:00+00:00"), "r+") as file:
            file.attrs["started_utc"] = started
    os.mkfifo(folder / "pipe.h5")
    (folder / "gone.h5").symlink_to(folder / "nothing")
    bad = {"text.h5", "foreign.h5", "cut.h5", "long.h5", "pipe.h5", "gone.h5", "first.h5", "last.h5"}
    begun = time.monotonic()
    # the process that a user starts, then forks of one
    for command, more in ((REAL, []), (MCCD, ["--test", "sinesweep"]), (MCCD, ["--status", "unreadable"])):
        done = mccd("log", "list", str(folder), "--json", *more, command=command, timeout=100.0)
        assert done.returncode == 0, done.stderr
        told = {Path(one["path"]).name: one for one in json.loads(done.stdout)["logs"]}
        assert {name for name, one in told.items() if one["error"]} == bad
        assert {one["status"] for one in told.values() if one["error"]} == {"unreadable"}
    assert time.monotonic() - begun < 100.0
    assert "schema" in told["foreign.h5"]["error"] and "note" in told["long.h5"]["error"]
    assert all("started_utc" in told[name]["error"] for name in ("first.h5", "last.h5"))
    text = mccd("log", "list", str(folder)).stdout.splitlines()
    assert len(text) == 1 + 3 + len(bad)


def test_flipped_bytes_never_stop_the_list(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = (folder / "a.h5").read_bytes()
    for i in range(40):
        place = (i * 7919) % min(len(content), 6000)
        flipped = bytes([content[place] ^ 0xFF])
        (folder / f"flipped-{i:02}.h5").write_bytes(content[:place] + flipped + content[place + 1 :])
    found = listed(capsys, str(folder))
    assert len(found) == 43
    assert any(one["error"] for one in found)


def test_only_headers_are_read(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # a chunk whose checksum does not fit any more: who reads its values is told
    path = write(folder / "chunk.h5", "chop", "2026-03-03T00:00:00+00:00")
    with h5py.File(path) as file:
        chunk = file["channels/angle"].id.get_chunk_info(0)
    content = bytearray(path.read_bytes())
    content[chunk.byte_offset] ^= 0xFF
    path.write_bytes(bytes(content))
    assert main(["log", "summary", str(path)]) == 4
    capsys.readouterr()
    assert "chunk.h5" in names([one for one in listed(capsys, str(folder)) if not one["error"]])


def test_an_empty_folder_and_a_wrong_date(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["log", "list", str(tmp_path)]) == 0
    assert "holds no log" in capsys.readouterr().out
    assert main(["log", "list", str(tmp_path), "--since", "yesterday"]) == 2
    assert "write it as in 2026-03-01" in capsys.readouterr().err


def test_a_note_goes_from_the_command_into_log_show_list_and_recovery(tmp_path: Path) -> None:
    note = "new wiring – 5 m cable"
    settings = ("--set", "steps_s=0.2", "--set", "noise_s=0.2", "--set", "held_out_s=0.2")
    done = mccd("simulate", *settings, "--note", note, "--out", "run.h5", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    with read_run(tmp_path / "run.h5") as run:
        assert run.header.note == note
    shown = mccd("log", "show", "run.h5", cwd=tmp_path).stdout.splitlines()
    assert ["note", *note.split()] in [line.split() for line in shown]
    assert mccd("log", "list", ".", cwd=tmp_path).stdout.rstrip().endswith(note)
    recover(tmp_path / "run.h5", tmp_path / "saved.h5")
    with read_run(tmp_path / "saved.h5") as run:
        assert run.header.note == note


def test_a_note_may_have_the_spaces_that_keyboards_give(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    note = "5\u00a0m cable, 12\u202f500\u2009Hz"
    write(folder / "spaces.h5", "chop", "2026-03-02T06:30:00+00:00", note=note)
    (one,) = listed(capsys, str(folder), "--note", "cable")
    assert one["note"] == note and one["error"] == ""


@pytest.mark.parametrize(
    ("note", "read"),
    [
        ("two\nlines", r"two\nlines"),
        ("\u202eback", r"\u202eback"),
        ("a\u2028b\x1b[2J", r"a\u2028b\x1b[2J"),
        ("\x1b" * 200, r"\x1b" * 124 + r"\x1" + "…"),
    ],
)
def test_a_log_whose_note_no_program_of_ours_writes_is_read_with_it_written_out(
    note: str, read: str, folder: Path, tmp_path: Path
) -> None:
    with h5py.File(folder / "a.h5", "r+") as file:
        file.attrs["note"] = note
    sidecar_of(folder / "a.h5").unlink()  # whoever wrote that may have kept no checksum
    with read_run(folder / "a.h5") as run:
        assert run.header.note == read and len(read) <= MAX_NOTE_CHARS
    recover(folder / "a.h5", tmp_path / "saved.h5")
    with pytest.raises(ConfigError, match="in one line"):
        LogWriter.create(tmp_path / "new.h5", CHANNELS, test="t", bench={}, note=note)


def test_every_run_of_a_campaign_and_an_import_keep_the_note(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(
        'schema = "mccd-campaign/1"\nname = "mine"\n[[runs]]\nname = "one"\nplan = "chop"\nsettings = { cycles = 1 }\n'
    )
    (tmp_path / "map.toml").write_text(
        '[log]\ntest = "x"\nsource = "data.csv"\nsample_rate_hz = 100.0\n'
        '[channels.u]\nselect = "u"\nunit = "N m"\nrole = "input"\n'
    )
    (tmp_path / "data.csv").write_text("u\n" + "\n".join(str((7919 * i) % 13) for i in range(100)) + "\n")
    for words, log in ((("campaign", "run", "mine.toml"), "mine/one.h5"), (("import", "map.toml"), "map.h5")):
        done = mccd(*words, "--note", "first light", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        with read_run(tmp_path / log) as run:
            assert run.header.note == "first light"


@pytest.mark.parametrize(("note", "says"), [("x" * 501, "501 characters"), ("two\nlines", "one line")])
def test_a_note_that_no_log_could_hold_is_refused_before_anything_moves(
    note: str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["chop", "--cycles", "1", "--note", note]) == 2
    assert says in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ConfigError, match=says):
        LogWriter.create("a.h5", CHANNELS, test="t", bench={}, note=note)


def test_a_log_of_before_reads_as_without_a_note(folder: Path) -> None:
    with h5py.File(folder / "z.h5") as file:
        assert "note" not in file.attrs
    with read_run(folder / "z.h5") as run:
        assert run.header.note == ""
