"""Trials on disk: to the last bit, held by one program, bound to their study, refused when damaged."""

from __future__ import annotations

import math
import sqlite3
import struct
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from analysis.study.kinds import Column
from analysis.study.store import FILE, Store
from analysis.study.trial import Outcome
from sim_backend.errors import ConfigError, DataError

COLUMNS = (Column("x", "a number"), Column("yes", "a flag", kind="flag"), Column("said", "a text", kind="text"))
PARTS = {"kind": "k", "settings": "a"}
VARIED = ('model.modes[a "b"].frequency_hz', "settings.strategy")


def opened(folder: Path, parts: dict[str, str] = PARTS, *, resume: bool = False) -> Store:
    return Store(folder, parts, VARIED, COLUMNS, resume=resume)


def test_every_bit_comes_back(tmp_path: Path) -> None:
    numbers = [0.1 + 0.2, 5e-324, -1.0, math.inf, -math.inf, 1.7976931348623157e308, math.nan]
    with opened(tmp_path) as store:
        store.add([Outcome(t, "done", "", (x, "hybrid"), (x, t % 2 == 0, f"t{t}"), 0.1) for t, x in enumerate(numbers)])
    with opened(tmp_path, resume=True) as store:
        back = store.numbers("x", len(numbers)).tolist()
        assert [x.hex() for x in back] == [x.hex() for x in numbers]
        assert store.numbers("yes", 3).tolist() == [1.0, 0.0, 1.0]
        assert store.texts("said", 2) == ["t0", "t1"]
        assert [row[0] for row in store.rows(3)] == [0, 1, 2]
        assert store.finished(9).tolist() == [True] * 7 + [False] * 2


def test_a_batch_is_whole_or_absent(tmp_path: Path) -> None:
    good = Outcome(0, "done", "", (1.0, "s"), (1.0, True, ""), 0.1)
    with opened(tmp_path) as store:
        store.add([good])
        again = Outcome(1, "done", "", (1.0, "s"), (1.0, True, ""), 0.1)
        with pytest.raises(DataError):
            store.add([again, good])  # trial 0 is there already
        assert store.finished(2).tolist() == [True, False]


def test_what_is_added_is_on_the_disk_when_add_returns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    connections: list[sqlite3.Connection] = []
    connect = sqlite3.connect

    def watched(*args: Any, **more: Any) -> sqlite3.Connection:
        connections.append(connect(*args, **more))
        return connections[-1]

    monkeypatch.setattr(sqlite3, "connect", watched)
    for resume in (False, True):
        with opened(tmp_path, resume=resume):
            # 2 is FULL: SQLite waits for the disk at the end of every transaction
            assert connections[-1].execute("PRAGMA synchronous").fetchone() == (2,)
            assert connections[-1].execute("PRAGMA journal_mode").fetchone() == ("wal",)


def test_a_disk_without_a_write_ahead_log_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Another(sqlite3.Connection):
        def execute(self, sql: str, *more: Any) -> sqlite3.Cursor:
            return super().execute("SELECT 'delete'" if "journal_mode" in sql else sql, *more)

    monkeypatch.setattr(sqlite3, "connect", partial(sqlite3.connect, factory=Another))
    with pytest.raises(DataError, match="no write-ahead log .SQLite offers 'delete'.; choose an --out on another"):
        opened(tmp_path)


def test_a_second_program_is_kept_out(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom pathlib import Path\n"
        "from analysis.study.store import Store\nfrom analysis.study.kinds import Column\n"
        f"Store(Path(sys.argv[1]), {PARTS!r}, {VARIED!r}, {COLUMNS!r}, resume=True)"
    )
    with opened(tmp_path):
        done = subprocess.run(
            [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, cwd=Path(__file__).parents[3]
        )
        assert "another mccd is running this study" in done.stderr
    opened(tmp_path, resume=True).close()


def test_another_study_is_refused_by_the_part_that_differs(tmp_path: Path) -> None:
    opened(tmp_path).close()
    with pytest.raises(ConfigError, match="holds trials already; go on with --resume"):
        opened(tmp_path)
    with pytest.raises(ConfigError, match="not the same study in its settings; go on with"):
        opened(tmp_path, {**PARTS, "settings": "b"}, resume=True)
    with pytest.raises(ConfigError, match="in its kind: other instead of k"):
        opened(tmp_path, {**PARTS, "kind": "other"}, resume=True)
    opened(tmp_path, resume=True).close()


def test_a_file_that_is_damaged_or_something_else_is_refused(tmp_path: Path) -> None:
    for name, content in (
        ("text", b"this is no database, but a text that is long enough to be read" * 20),
        ("cut", None),
    ):
        folder = tmp_path / name
        folder.mkdir()
        if content is None:
            with opened(folder) as store:
                many = [Outcome(t, "done", "", (1.0, "s"), (1.0, True, "x" * 200), 0.1) for t in range(500)]
                store.add(many)
            whole = (folder / FILE).read_bytes()
            content = whole[: len(whole) // 2]
        (folder / FILE).write_bytes(content)
        with pytest.raises(DataError, match=FILE):
            opened(folder, resume=True)


def test_a_database_of_another_kind_is_refused(tmp_path: Path) -> None:
    file = sqlite3.connect(tmp_path / FILE)
    file.execute("CREATE TABLE study (part TEXT PRIMARY KEY, value TEXT NOT NULL)")
    file.execute("INSERT INTO study VALUES ('schema', 'something/9')")
    file.commit()
    file.close()
    with pytest.raises(DataError, match="something/9"):
        opened(tmp_path, resume=True)


ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i, i FROM n"


def test_a_journal_that_would_be_played_back_is_refused_and_deletes_nothing(tmp_path: Path) -> None:
    """SQLite deletes the file that a journal names at its end."""
    study, victim = tmp_path / "study", tmp_path / "thesis.tex"
    victim.write_text("mine")
    opened(study).close()
    file = sqlite3.connect(study / FILE)
    file.execute("PRAGMA journal_mode=DELETE")
    (page_bytes,) = file.execute("PRAGMA page_size").fetchone()
    file.close()
    magic, name = bytes([0xD9, 0xD5, 0x05, 0xF9, 0x20, 0xA1, 0x63, 0xD7]), str(victim).encode()
    pages = (study / FILE).stat().st_size // page_bytes
    head = (magic + struct.pack(">IIIII", 0, 1, pages, 512, page_bytes)).ljust(512, b"\0")
    tail = struct.pack(">I", 0x40000000 // page_bytes + 1) + name + struct.pack(">II", len(name), sum(name)) + magic
    (study / f"{FILE}-journal").write_bytes(head + tail)
    with pytest.raises(DataError, match="which keeps a write-ahead log"):
        opened(study, resume=True)
    assert victim.read_text() == "mine"


@pytest.mark.parametrize(
    ("statement", "said"),
    [
        ("UPDATE trials SET x = 'text'", "trial 0 holds what no trial is kept as"),
        ("UPDATE trials SET x = x'ff'", "trial 0 holds what no trial is kept as"),
        ("UPDATE trials SET status = x'ff'", "trial 0 holds what no trial is kept as"),
        ("UPDATE trials SET wall_s = 'text'", "trial 0 holds what no trial is kept as"),
        ("UPDATE trials SET trial = -1", "trial -1 holds what no trial is kept as"),
        ("ALTER TABLE trials DROP COLUMN yes", "its trials have the columns"),
        ("DROP TABLE trials", "its trials have the columns"),
        ("UPDATE study SET value = '[' WHERE part = 'fingerprint'", "not valid JSON"),
        ("UPDATE study SET value = '[1]' WHERE part = 'fingerprint'", "which study it is of"),
        ("DELETE FROM study WHERE part = 'fingerprint'", "not valid JSON"),
        ("UPDATE study SET value = x'00ff'", "Could not decode"),
        ("DROP TABLE study; CREATE TABLE study (a)", "another format"),
        (f"DROP TABLE trials; CREATE VIEW trials AS {ENDLESS}", "the view 'trials' in another format"),
        (f"DROP TABLE study; CREATE VIEW study AS {ENDLESS}", "the view 'study' in another format"),
        (f"CREATE TRIGGER t AFTER INSERT ON trials BEGIN INSERT INTO study {ENDLESS}; END", "the trigger 't'"),
        ("CREATE INDEX i ON trials (hex(zeroblob(x)))", "the index 'i'"),
        ("ALTER TABLE trials ADD COLUMN more AS (hex(zeroblob(500000000)))", "in another format"),
    ],
)
def test_what_no_program_of_ours_has_written_is_refused(tmp_path: Path, statement: str, said: str) -> None:
    with opened(tmp_path) as store:
        store.add([Outcome(0, "done", "", (1.0, "s"), (1.0, True, ""), 0.1)])
    file = sqlite3.connect(tmp_path / FILE)
    file.executescript(statement)
    file.close()
    with pytest.raises(DataError, match=said):
        opened(tmp_path, resume=True)
