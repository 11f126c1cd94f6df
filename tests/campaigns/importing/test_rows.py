"""Rows counted in blocks are those that are seen one by one, wherever a block ends."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from campaigns.importing import dialect as dialects
from campaigns.importing.dialect import Dialect
from campaigns.importing.rows import Rows
from sim_backend.errors import DataError

WRITTEN = st.text(st.sampled_from('12,;\t "#\nä\x1c'), max_size=60)
BLOCK = 16
"""So many characters are looked at together: most texts above take several blocks."""


def one_by_one(rows: Rows) -> tuple[int, bool] | str:
    try:
        found = list(rows.lines())
    except DataError as error:
        return str(error)
    return sum(data is not None for _, _, data in found), any(data is not line for _, line, data in found)


def together(rows: Rows) -> tuple[int, bool] | str:
    try:
        return rows.checked
    except DataError as error:
        return str(error)


@given(WRITTEN, st.sampled_from([",", ";", "\t", " "]), st.integers(1, 3), st.integers(0, 2), st.booleans())
@example("1,2\n\n1,2\n", ",", 2, 0, False)
@example("1\n \n2", ",", 1, 0, False)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_the_count_the_remarks_and_the_first_fault_are_the_same(
    tmp_path: Path, text: str, separator: str, columns: int, first: int, trailing: bool
) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text, encoding="utf-8", newline="")
    written = Dialect("utf-8", separator, ".", columns, (), (), first, trailing, "")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dialects, "MAX_LINE_CHARS", BLOCK)
        rows = Rows(path, written)
        assert together(rows) == one_by_one(rows)
        if isinstance(one_by_one(rows), tuple):
            seen = [(number, data) for number, _, data in rows.lines() if data is not None]
            assert [rows.row(i) for i in range(len(seen))] == seen


def test_a_line_as_long_as_a_block_is_refused_wherever_it_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dialects, "MAX_LINE_CHARS", BLOCK)
    path, written = tmp_path / "a.csv", Dialect("utf-8", ",", ".", 1, (), (), 0, False, "")
    for before in range(BLOCK):
        for length, refused in ((BLOCK - 2, False), (BLOCK - 1, True), (2 * BLOCK, True)):
            path.write_text("1" * before + "\n" + "1" * length + "\n1\n" if before else "1" * length + "\n1\n")
            rows = Rows(path, written)
            if refused or before >= BLOCK - 1:
                with pytest.raises(DataError, match="a line of more than 16 characters"):
                    _ = rows.checked
            else:
                assert rows.checked == (2 + bool(before), False)
