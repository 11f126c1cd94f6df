"""A known table written in drawn dialects comes back exactly, or is refused; nothing differs without a word."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from campaigns.importing.text import TextSource
from sim_backend.errors import DataError

NUMBER = st.one_of(
    st.floats(-1e6, 1e6, allow_nan=False),
    st.integers(-100_000, 100_000).map(float),
    st.sampled_from([0.0, 1.0, -0.0, 1e-300, 1e300]),
)
NAME = st.text(st.characters(codec="utf-8", categories=("L", "N"), include_characters="_ ()[]/°%-"), max_size=12)


DIALECTS = st.fixed_dictionaries(
    {
        "separator": st.sampled_from([",", ";", "\t", " ", "|"]),
        "decimal": st.sampled_from([".", ","]),
        "head": st.sampled_from(["names", "none", "remark", "preamble", "units"]),
        "form": st.sampled_from(["%r", "%.17g", "%.17e", "%.3f", "D"]),
        "quotes": st.booleans(),
        "encoding": st.sampled_from(["utf-8", "utf-8-sig", "utf-16"]),
        "newline": st.sampled_from(["\n", "\r\n", "\r"]),
        "padding": st.sampled_from(["", " ", "  "]),
        "end": st.sampled_from(["", "\n", "\n\n"]),
        "told": st.booleans(),
    }
)


@st.composite
def tables(draw: st.DrawFn) -> tuple[np.ndarray, list[str], dict[str, Any]]:
    columns, rows = draw(st.integers(1, 5)), draw(st.integers(1, 8))
    values = np.array([[draw(NUMBER) for _ in range(columns)] for _ in range(rows)])
    names = [draw(NAME) for _ in range(columns)]
    return values, names, sound(draw(DIALECTS))


@st.composite
def plain_tables(draw: st.DrawFn) -> tuple[np.ndarray, list[str], dict[str, Any]]:
    """Draw a table in which nothing can be read in two ways: two columns and more, names, numbers with fractions."""
    columns, rows = draw(st.integers(2, 5)), draw(st.integers(2, 8))
    fraction = st.floats(-1e6, 1e6).map(lambda value: round(value) + 0.015625)  # five digits: no thousands
    values = np.array([[draw(fraction) for _ in range(columns)] for _ in range(rows)])
    names = draw(st.permutations(["time", "drive current", "angle x", "Kraft", "µ"]))[:columns]
    dialect = sound(draw(DIALECTS.filter(lambda dialect: dialect["form"] != "%.3f")))
    if dialect["separator"] == " ":
        names = [name.replace(" ", "_") for name in names]
    return values, names, dialect


def sound(dialect: dict[str, Any]) -> dict[str, Any]:
    """Return a dialect that can be read at all."""
    if dialect["separator"] == dialect["decimal"]:
        dialect["quotes"] = True  # without them nobody could tell one number with a comma from two
    return dialect


def cell(value: float, dialect: dict[str, Any]) -> str:
    form = str(dialect["form"])
    if form == "%r":
        text = repr(float(value))
    elif form == "D":
        text = f"{value:.17e}".replace("e", "D")
    else:
        text = form % value
    return text.replace(".", str(dialect["decimal"]))


def as_written(values: np.ndarray, dialect: dict[str, Any]) -> np.ndarray:
    return np.round(values, 3) if dialect["form"] == "%.3f" else values


def text_of(values: np.ndarray, names: list[str], dialect: dict[str, Any]) -> str:
    separator = str(dialect["separator"]) + str(dialect["padding"])
    quote = '"' if dialect["quotes"] else ""
    lines = [separator.join(f"{quote}{cell(v, dialect)}{quote}" for v in row) for row in values.tolist()]
    shown = separator.join(f"{quote}{name}{quote}" for name in names)
    head = {
        "names": [shown],
        "none": [],
        "remark": [f"# {shown}"],
        "preamble": ["Recorder", "", shown],
        "units": [shown, separator.join(["V"] * len(names))],
    }[str(dialect["head"])]
    return str(dialect["newline"]).join([*head, *lines]) + str(dialect["end"])


def comes_back(values: np.ndarray, names: list[str], dialect: dict[str, Any]) -> bool:
    """Tell whether a table was read, having checked that it was read right, or refused by its name."""
    told = {"separator": dialect["separator"], "decimal": dialect["decimal"]} if dialect["told"] else {}
    if dialect["head"] in ("names", "preamble") and all(name.isdecimal() for name in names):
        told["header"] = True  # without it nobody could tell whole numbers that name columns from data
        # nor a title from the name of a single column
        assume(dialect["head"] == "names" or len(names) > 1)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.txt"
        path.write_bytes(text_of(values, names, dialect).encode(str(dialect["encoding"])))
        source = TextSource(path, **told)
        try:
            found = source.array("")
        except DataError as error:
            assert "a.txt" in str(error) and "\n" not in str(error)
            return False
        point = dialect | {"decimal": "."}
        wanted = [[float(cell(v, point).replace("D", "e")) for v in row] for row in values]
        np.testing.assert_array_equal(found, wanted)
    return True


UNHURRIED: dict[str, Any] = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}


@settings(max_examples=300, **UNHURRIED)
@given(tables())
def test_a_table_comes_back_exactly_or_is_refused(drawn: tuple[np.ndarray, list[str], dict[str, Any]]) -> None:
    comes_back(*drawn)


@settings(max_examples=100, **UNHURRIED)
@given(plain_tables())
def test_a_plain_table_is_read(drawn: tuple[np.ndarray, list[str], dict[str, Any]]) -> None:
    assert comes_back(*drawn)


@settings(max_examples=10_000, **UNHURRIED)
@given(tables())
def test_ten_thousand_tables(drawn: tuple[np.ndarray, list[str], dict[str, Any]]) -> None:
    comes_back(*drawn)


@pytest.mark.parametrize("head", ["names", "none", "remark", "preamble", "units"])
def test_most_tables_are_read_and_not_refused(head: str) -> None:
    """Whoever refuses everything makes no mistake either."""
    values = np.array([[0.5, -1.25, 3.0], [0.625, 2.0, -4.5]])
    for separator in (",", ";", "\t", " ", "|"):
        for decimal in (".", ","):
            dialect: dict[str, Any] = {
                "separator": separator,
                "decimal": decimal,
                "head": head,
                "form": "%r",
                "newline": "\n",
                "quotes": separator == decimal,
                "padding": "",
                "end": "\n",
                "told": False,
                "encoding": "utf-8",
            }
            with TemporaryDirectory() as folder:
                path = Path(folder) / "a.txt"
                path.write_text(text_of(values, ["t", "u", "y"], dialect), encoding="utf-8")
                np.testing.assert_array_equal(TextSource(path).array(""), values)
