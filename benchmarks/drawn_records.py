"""Records that hypothesis draws: what was measured, how it is stored, and at most one flaw."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from hypothesis import strategies as st

from campaigns.importing.clock import SECONDS
from campaigns.log.units import UNITS

TEXT = ("csv", "tsv", "txt", "dat", "asc")

LAYOUTS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        **dict.fromkeys(TEXT, ("table",)),
        "archive": ("table",),
        "npy": ("matrix",),
        "npz": ("plain", "matrix"),
        "h5": ("plain", "group", "compound", "matrix", "packed"),
        "mat 5": ("plain", "structure", "matrix"),
        "mat 7.3": ("plain", "structure", "matrix"),
        "nc 3": ("plain", "matrix", "packed"),
        "nc 4": ("plain", "group", "packed"),
        "tdms": ("plain",),
        "parquet": ("plain",),
    }
)
"""Every form, and how its variables may lie in a file of it."""

FORMS = tuple(LAYOUTS)
DATED = (*TEXT, "archive", "tdms", "parquet")
"""Forms that have dates."""

TELLS = {"h5": ("plain", "group", "packed"), "nc 3": ("plain", "packed"), "nc 4": ("plain", "group", "packed")}
TELLS |= {"tdms": ("plain",), "parquet": ("plain",)}
"""Forms and layouts with a place for the unit of a variable, besides text."""

REFUSED = ("missing", "lost sample", "other unit", "short", "constant")
"""Flaws that no import may read over."""

FLAWS = (*REFUSED, "bare commas")
"""With decimal commas between commas a table is read right or refused."""

SOUND = 12
"""So many times as often as with one flaw is a record drawn without any."""

COUNT_FILL, FLOAT_FILL = -32768, 1e20
NAMES = (("u", "y"), ("drive current", "angle 1"), ("Ch1", "Ch2"), ("u.cmd", "y.meas"), ("µ", "é"), ("u (cmd)", "y,2"))
PLAIN_NAMES = (("u", "y"), ("drive_current", "angle1"), ("Ch1", "Ch2"))


@dataclass(frozen=True)
class Record:
    """Two channels as they are stored, (n,) each, their clock and units, and how the file is written.

    `told` says where the unit of time stands: in the time's name, in the file beside it, or in the map alone.
    """

    form: str
    layout: str
    stored: tuple[np.ndarray, np.ndarray]
    names: tuple[str, str]
    clock: str
    told: str
    whole_stamps: bool
    rate_hz: float
    late_s: float
    units: tuple[str, str]
    told_units: tuple[str, str] | None
    scale: float
    packing: tuple[float, float]
    resample: str
    style: Mapping[str, Any]
    flaw: str | None
    at: int
    """The sample, and its parity the channel, in which a flaw is."""

    @property
    def rows(self) -> int:
        """Samples before any is lost."""
        return int(self.stored[0].size)

    @property
    def is_text(self) -> bool:
        """Whether the file is a text table."""
        return self.form in TEXT or self.form == "archive"

    @property
    def stamps(self) -> np.ndarray:
        """Stamps (n,) in the unit of the clock, or as dates; lost samples are among them."""
        seconds = self.late_s + np.arange(self.rows) / self.rate_hz
        if self.clock == "date":
            return np.datetime64("2026-11-25T11:00:00", "us") + np.round(1e6 * seconds).astype("timedelta64[us]")
        found = seconds / SECONDS[self.clock if self.clock != "rate" else "s"]
        return np.round(found).astype(np.int64) if self.whole_stamps else found

    @property
    def kept(self) -> np.ndarray:
        """Which samples (n,) the file has."""
        lost = self.flaw == "lost sample"
        return np.arange(self.rows) != (self.at if lost else -1)


def number_text(value: float, form: str) -> str:
    """Return how a number is written, with a decimal point."""
    return repr(value) if form == "%r" else form % value


def meant(record: Record, channel: int) -> np.ndarray:
    """Return what the file means by the numbers (n,) of a channel, in the unit of the source."""
    values = record.stored[channel]
    if record.layout == "packed":
        factor, offset = record.packing
        return values * factor + offset
    if record.is_text:
        form = str(record.style["number"])
        return np.array([float(number_text(value, form)) for value in values.tolist()])
    return values.astype(np.float64)


STYLES = st.fixed_dictionaries(
    {
        "separator": st.sampled_from([",", ";", "\t", " ", "|"]),
        "decimal": st.sampled_from([".", ","]),
        "quotes": st.booleans(),
        "head": st.sampled_from(["names", "none", "remark", "preamble"]),
        "number": st.sampled_from(["%r", "%.17g", "%.17e", "%.6g"]),
        "encoding": st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1252"]),
        "newline": st.sampled_from(["\n", "\r\n", "\r"]),
        "below": st.booleans(),
        "hole": st.sampled_from(["nan", "NaN", "", "-", "inf", "#N/A", "overload"]),
        "date": st.sampled_from(["iso", "german"]),
        "mixed": st.booleans(),
        "big_endian": st.booleans(),
        "packed_file": st.booleans(),
    }
)


@st.composite
def records(draw: st.DrawFn, forms: tuple[str, ...] = FORMS) -> Record:
    """Draw a record in one of the forms."""
    form = draw(st.sampled_from(forms))
    layout = draw(st.sampled_from(LAYOUTS[form]))
    clock = draw(st.sampled_from(_clocks(form)))
    style = _sound(form, draw(STYLES))
    units = (draw(st.sampled_from(sorted(UNITS))), draw(st.sampled_from(sorted(UNITS))))
    flaw = draw(st.sampled_from([*[None] * SOUND, *_flaws(form, layout, clock, style)]))
    rows, rate_hz = draw(st.integers(6, 40)), draw(st.sampled_from([1.0, 10.0, 250.0, 1000.0]))
    late_s = draw(st.sampled_from([0.0, 3.5]))
    told_units = units if _tells(form, layout, style) and (draw(st.booleans()) or flaw == "other unit") else None
    if told_units and flaw == "other unit":
        other = draw(st.sampled_from([symbol for symbol in sorted(UNITS) if _differ(symbol, units[0])]))
        told_units = (other, units[1])
    in_file = (_tells(form, layout, style) and (told_units is not None or form not in TEXT)) and clock != "date"
    by_name = layout != "matrix" and style["head"] != "none"
    told = draw(st.sampled_from(["map", *(["name"] if by_name else []), *(["file"] if in_file else [])]))
    named = style["head"] != "none" and form not in ("mat 5", "mat 7.3", "nc 3", "npy") and layout != "matrix"
    return Record(
        form,
        layout,
        _values(draw, form, layout, rows, flaw),
        draw(st.sampled_from(NAMES if named else PLAIN_NAMES)),
        clock,
        told,
        _may_be_whole(clock, rate_hz, late_s) and draw(st.booleans()),
        rate_hz,
        late_s,
        units,
        told_units,
        draw(st.sampled_from([1.0, -2.0, 0.125])),
        (draw(st.sampled_from([2e-3, 1.0 / 3.0])), draw(st.sampled_from([0.0, 0.5]))),
        draw(st.sampled_from(["hold", "linear", "cubic"])),
        style,
        flaw,
        draw(st.integers(1, rows - 2)),
    )


def _clocks(form: str) -> tuple[str, ...]:
    own = [] if form == "archive" else ["rate"]
    return (*own, *SECONDS, *(["date"] if form in DATED else []))


def _may_be_whole(clock: str, rate_hz: float, late_s: float) -> bool:
    if clock in ("rate", "date"):
        return False
    step, first = 1.0 / (rate_hz * SECONDS[clock]), late_s / SECONDS[clock]
    return abs(step - round(step)) < 1e-6 and round(step) > 0 and abs(first - round(first)) < 1e-6


def _sound(form: str, style: dict[str, Any]) -> dict[str, Any]:
    """Return a style that can be read in one way only."""
    if form == "tsv":
        style["separator"] = "\t"
    if form == "archive" and style["head"] == "none":
        style["head"] = "names"
    if form not in (*TEXT, "archive"):
        style["head"] = "names"
    if style["separator"] == style["decimal"]:
        style["quotes"] = True  # without them nobody could tell one number with a comma from two
    if style["separator"] == " " and style["hole"] == "":
        style["hole"] = "nan"  # blanks around nothing are blanks
    return style


def _tells(form: str, layout: str, style: Mapping[str, Any]) -> bool:
    return style["head"] != "none" if form in TEXT else layout in TELLS.get(form, ())


def _differ(one: str, other: str) -> bool:
    a, b = UNITS[one], UNITS[other]
    return (a.si, a.factor, a.offset) != (b.si, b.factor, b.offset)


def _flaws(form: str, layout: str, clock: str, style: Mapping[str, Any]) -> list[str]:
    """Return the flaws that such a record can have."""
    found = ["missing", "constant"]
    if clock != "rate" and form != "archive":
        found.append("lost sample")
    if _tells(form, layout, style):
        found.append("other unit")
    if layout in ("plain", "group", "structure") or form in TEXT:
        found.append("short")
    if form in TEXT and style["separator"] == style["decimal"]:
        found += ["bare commas"] * SOUND  # few tables have the signs for it
    return [flaw for flaw in found if not (flaw == "short" and form in ("parquet", "nc 3"))]


def _values(draw: st.DrawFn, form: str, layout: str, rows: int, flaw: str | None) -> tuple[np.ndarray, np.ndarray]:
    """Draw the stored numbers (n,) of both channels: of one type, as a matrix and most recorders have them."""
    rng = np.random.default_rng(draw(st.integers(0, 2**31)))
    exact = rng.standard_normal((2, rows)) * 10.0 ** draw(st.integers(-3, 3))
    counts = rng.integers(-30_000, 30_000, (2, rows))
    kind = draw(st.sampled_from(["f8", "f8", "f4", "i2", "i4", "u1"]))
    if layout == "packed":
        kind = "i2"
    if form in (*TEXT, "archive"):
        kind = "f8"
    if flaw == "missing" and layout != "packed" and kind[0] != "f":
        kind = "f8"  # whole numbers have no place for one that is missing
    if form == "nc 3" and kind == "u1":
        kind = "i2"
    values = (exact if kind[0] == "f" else counts & 0xFF if kind == "u1" else counts).astype(kind)
    if flaw == "constant":
        values[0] = values[0, 0]
    return values[0], values[1]
