"""What `soak_hostile` does to the files of a folder: values, headers, statements and bytes that nobody expects."""

from __future__ import annotations

import json
import os
import random
import re
import sqlite3
import warnings
import zipfile
from pathlib import Path
from typing import Any

NUMBERS = (
    "nan", "inf", "-inf", "1e308", "-1e308", "1e-300", "5e-324", "0", "-0.0", "0.0", "-1", "1", "2", "0.5",
    "1e9", "3e12",
    "1000000000", "20000000", "9223372036854775807", "18446744073709551616", "1" + "0" * 30, "1" * 5000, "1e-9",
)  # fmt: skip
TEXTS = (
    "", " ", "-", "--", "~", "/", ".", "..", "../outside", "/dev/null/x", "no such", "a" * 5000,
    "\U0001f600", "\udcff",
    "tab\there", "line\nbreak", "\x1b[31m", "%s%n{}", "true", "1979-05-27", "'", '"', "[", "{", "[[", "a=b",
    "[1, 2]", "x,y",
    "[]", "{}", "[nan]", "{ a = 1 }", '""', "null", "1970-13-45", "[" * 100_000, "[" * 2_000 + "]" * 2_000,
    "x" * 1_000_000,
)  # fmt: skip


def write(path: Path, content: bytes) -> None:
    """Write a file in place of a file, a link or nothing."""
    if path.is_symlink() or path.is_file() or not path.exists():
        path.unlink(missing_ok=True)
        path.write_bytes(content)


def changed(path: Path, rng: random.Random) -> None:
    """Change a file in the folder: as text of its kind, its bytes, or what it is."""
    if not path.is_file():
        return
    kind = rng.random()
    content = path.read_bytes()
    if kind < 0.05:
        write(path, rng.choice([b"", b"\0" * 1000, b"\xff\xfe", os.urandom(100), b"{" * 100_000, b"[" * 100_000, b'"']))
    elif kind < 0.1:
        path.unlink()
        left = rng.choice(("folder", "link", "nothing"))
        if left == "folder":
            path.mkdir()
        elif left == "link":
            path.symlink_to("nowhere")
    elif path.suffix in (".toml", ".csv"):
        write(path, _text(content, rng))
    elif path.suffix == ".json":
        write(path, _json(content, rng))
    elif path.suffix == ".sqlite":
        _sqlite(path, rng)
    elif path.suffix in (".npy", ".npz") and rng.random() < 0.7:
        _numpy(path, rng)
    else:
        out = bytearray(content)
        for _ in range(rng.randrange(1, 9)):
            out[rng.randrange(len(out)) if out else 0 : 0] = b""
            if out:
                out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
        write(path, bytes(out[: rng.randrange(len(out) + 1)] if rng.random() < 0.2 else out))


def _hostile(rng: random.Random) -> str:
    return rng.choice(NUMBERS + TEXTS + ('"text"', "true", "[[[1]]]", "{ a = { b = 1 } }", '"' + "x" * 100_000 + '"'))


def _text(content: bytes, rng: random.Random) -> bytes:
    """Put a hostile value in place of one in TOML or CSV, or drop or repeat a line."""
    text = content.decode("utf-8", "surrogateescape")
    values = list(re.finditer(r"(?<=[=,\[] )[^\s,\]}]+|(?<=,)[^,\n]+|(?<=\n)[^,\n=]+(?=,)", text))
    if values and rng.random() < 0.8:
        found = rng.choice(values)
        text = text[: found.start()] + _hostile(rng) + text[found.end() :]
    else:
        lines = text.splitlines(keepends=True) or [""]
        at = rng.randrange(len(lines))
        lines[at : at + 1] = rng.choice(
            [[], [lines[at]] * 2, lines[at : at + 1] * 0 + [_hostile(rng) + "\n"], lines[:at]]
        )
        text = "".join(lines)
    return text.encode("utf-8", "surrogateescape")


SHAPES = "(-1,)", "(2, -3)", "(1073741824,)", "(9223372036854775807,)", "(0,)", "()", "(", "(((", "(1.5,)", "(True,)"
TYPES = "'<f8'", "'|O'", "'<U1000000000'", "[('a', '<f8')]", "'>f4'", "'V0'", "'nonsense'", "None"


def _numpy(path: Path, rng: random.Random) -> None:
    """Write an array, or an archive of some, whose header claims what it does not hold."""
    shape = rng.choice((*SHAPES, f"({'-' * 9000}1,)", f"({'(' * 5000}"))
    text = (
        f"{{'descr': {rng.choice(TYPES)}, 'fortran_order': {rng.choice(('True', 'False', '7'))}, 'shape': {shape}}}\n"
    )
    length = rng.choice((len(text), len(text), 65535, 0))
    array = b"\x93NUMPY\x01\x00" + length.to_bytes(2, "little") + text.encode() + bytes(rng.choice((0, 7, 320)))
    if path.suffix == ".npy":
        write(path, array)
        return
    path.unlink()
    names = rng.choice(
        (("x",), ("x", "x"), ("x", "x.npy"), ("../x", "x"), tuple(f"{i}" for i in range(70_000)) + ("x",))
    )
    with warnings.catch_warnings(), zipfile.ZipFile(path, "w", rng.choice((0, 8, 12, 14))) as archive:
        warnings.simplefilter("ignore")  # of two members of one name
        for name in names:
            archive.writestr(f"{name}.npy", array if len(names) < 9 else b"")


VALUES: tuple[Any, ...] = (
    None,
    True,
    0,
    -1,
    1e308,
    5e-324,
    10**30,
    "",
    "x" * 100_000,
    [],
    {},
    [[[1]]],
    {"a": {"b": 1}},
    float("nan"),
    "text",
)


def _json(content: bytes, rng: random.Random) -> bytes:
    """Put a hostile value in place of one in JSON, or drop it."""
    try:
        whole = json.loads(content)
    except (ValueError, RecursionError):  # a file that a change before this one has nested too deep
        return content[: rng.randrange(len(content) + 1)]
    top: dict[str, Any] = {"": whole}
    node: Any = top
    at: Any = ""
    for _ in range(rng.randrange(1, 6)):
        inner = node[at]
        if isinstance(inner, dict | list) and inner:
            node, at = inner, rng.choice(list(inner)) if isinstance(inner, dict) else rng.randrange(len(inner))
    if rng.random() < 0.25 and isinstance(node, dict) and at:
        del node[at]
    else:
        node[at] = rng.choice(VALUES)
    return json.dumps(top[""]).encode()


ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i, i FROM n"
STATEMENTS = (
    "DROP TABLE study", "DROP TABLE trials", "DELETE FROM study", "UPDATE study SET value = 'x'", "DELETE FROM trials",
    "UPDATE study SET value = '[1, 2]' WHERE part = 'fingerprint'", "UPDATE study SET value = x'00ff'",
    "UPDATE study SET value = '[]'", "UPDATE trials SET status = 'other'", "UPDATE trials SET wall_s = 'text'",
    "UPDATE trials SET trial = trial + 1000000", "UPDATE trials SET trial = -1 - trial",
    "ALTER TABLE trials DROP COLUMN reason",
    "UPDATE trials SET drift_m_s = 'text', noise_3sigma_m = x'ff'", "UPDATE trials SET noise_3sigma_m = NULL",
    "UPDATE trials SET noise_3sigma_m = 9e999", "ALTER TABLE trials RENAME COLUMN noise_3sigma_m TO other",
    "CREATE TABLE more (a)", f"DROP TABLE trials; CREATE VIEW trials AS {ENDLESS}",
    f"DROP TABLE study; CREATE VIEW study AS {ENDLESS}",
    f"CREATE TRIGGER t AFTER INSERT ON trials BEGIN INSERT INTO study {ENDLESS}; END",
    "CREATE INDEX i ON trials (hex(zeroblob(trial + 500000000)))",
    "ALTER TABLE trials ADD COLUMN more AS (hex(zeroblob(500000000)))", "DROP TABLE trials; CREATE TABLE trials (a)",
    "DROP TABLE study; CREATE TABLE study (part, value)",
    "UPDATE trials SET status = x'ff'", "UPDATE trials SET reason = 7", "PRAGMA user_version = 7",
    "UPDATE study SET value = '\"text\"' WHERE part = 'fingerprint'",
    "UPDATE study SET value = '{\"a\": 1}' WHERE part = 'fingerprint'",
)  # fmt: skip


def _sqlite(path: Path, rng: random.Random) -> None:
    """Change what a database says, or its bytes."""
    if rng.random() < 0.3:
        content = bytearray(path.read_bytes())
        for _ in range(rng.randrange(1, 20)):
            content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        return write(path, bytes(content))
    try:
        file = sqlite3.connect(path)
        file.executescript(rng.choice(STATEMENTS))
        file.commit()
        file.close()
    except sqlite3.Error:
        return
