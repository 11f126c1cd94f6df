"""What the document says is what the code does."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np

from campaigns.serial.commands import HEADERS, PROTOCOL, Code, State
from campaigns.serial.description import decode_description
from campaigns.serial.frames import Line, blocks_in, parse_line
from campaigns.serial.program import encode_segment
from sim_backend.bench import Gate, Segment
from sim_backend.control.blocks import filter_from_zpk

TEXT = (Path(__file__).parents[3] / "docs" / "serial-protocol.md").read_text(encoding="utf-8")


def test_the_checked_line() -> None:
    example = re.search(r"^ +(STAT\? @.*)$", TEXT, re.MULTILINE)
    assert example is not None and parse_line(example[1].encode()) == Line("STAT?", 0xA7)


def test_every_command_is_documented_with_its_short_form_in_capitals() -> None:
    said = {word for row in re.findall(r"^\| `([*A-Z][^`]*)` \|", TEXT, re.MULTILINE) for word in [row.split()[0]]}
    assert {header.upper() for header in said} == set(HEADERS)
    for header in said:
        short = "".join(c for c in header if not c.islower())
        assert HEADERS[header.upper()] == short


def test_every_error_and_state_is_documented() -> None:
    errors = TEXT.partition("## Errors")[2].partition("## ")[0]
    said = {int(c.replace("−", "-")) for row in re.findall(r"^\| ([−0-9, ]+) \|", errors, re.M) for c in row.split(",")}
    assert said == {int(code) for code in Code} - {0}
    assert set(re.findall(r"^\| `([a-z]+)` \|", TEXT, re.M)) == {state.value for state in State}
    assert f"`{PROTOCOL}`" in TEXT


def test_the_description_can_be_read() -> None:
    found = re.search(r"```json\n(.*?)```", TEXT, re.DOTALL)
    assert found is not None and decode_description(found[1].encode()).axes == ("theta_x", "theta_y", "z")


def test_the_conversation_adds_up() -> None:
    upload, count = re.search(r"SEGM:BEG 1,(\d+),.*\n.*SEGM:DATA 1,0,(\d+)", TEXT).groups()  # type: ignore[union-attr]
    assert blocks_in(int(upload)) == int(count)
    rows, columns, size = re.search(r"◂ (\d+),(\d+),(\d+),\d+\n.*REC:DATA", TEXT).groups()  # type: ignore[union-attr]
    assert int(size) == 8 * int(rows) * int(columns)
    assert f"REC:DATA? 1,0,{blocks_in(int(size))}" in TEXT


def test_an_image_written_by_hand_from_the_table() -> None:
    """Field by field as the document lists them, without the product's own layouts."""
    wave = np.array([[1.0, 0.0], [2.0, 0.0], [3.0, 0.0]])
    feedback = filter_from_zpk([0.5], [1.0], 2.0, 1e4)
    segment = Segment(
        "ab", 9, np.zeros((3, 2)), wave, feedback=(None, feedback), gates=(Gate(2, 1, True, 0.5),), record=("y",)
    )
    expected = b"".join(
        [
            b"MSEG" + struct.pack("<HH", 1, 2) + struct.pack("<Q", 9) + struct.pack("<I", 3),
            struct.pack("<HHIHH", 2, 1, 1, 2, 0) + struct.pack("<d", np.nan),
            b"ab" + struct.pack("<H", 1),
            struct.pack("<IHHd", 2, 1, 1, 0.5),
            struct.pack("<Hhdd", 0, -2, 0.0, 0.0),
            struct.pack("<Hhdd", 1, 0, 1e4, 2.0) + feedback.a.tobytes() + feedback.b.tobytes() + feedback.c.tobytes(),
            b"\0\0" + b"\1\0" + struct.pack("<3d", 1.0, 2.0, 3.0),
        ]
    )
    assert encode_segment(segment, ("x", "y")) == expected
