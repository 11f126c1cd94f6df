"""The clock of an import: stamps of any unit, numbers or dates, to the rate of a uniform grid."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from sim_backend.errors import DataError

Array = NDArray[np.float64]
TimeUnit = Literal["s", "ms", "us", "µs", "ns", "min", "h", "d", "date"]
Method = Literal["hold", "linear", "cubic"]

SECONDS = MappingProxyType({"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0, "d": 86_400.0})
"""Seconds in a unit of time."""

GRID_TOLERANCE = 0.01
"""Largest distance of a stamp from the uniform grid, in sample periods.

Stamps printed with two digits below the sample period are off by half of the last digit, 0.5 % of a period, and so are
the two stamps at the ends that the grid is drawn through. A lost sample is off by 100 %.
"""

LATEST_S = 4e9
"""No clock of seconds stands there before the year 2096: what does counts in another unit."""

EPOCH_S = 1e8
"""A time of the run that is larger is a date: it is more than three years."""

_SPELLED = MappingProxyType(
    {"sec": "s", "secs": "s", "second": "s", "seconds": "s", "msec": "ms", "millisecond": "ms", "milliseconds": "ms"}
    | {"millis": "ms", "usec": "us", "micros": "us", "microsecond": "us", "microseconds": "us", "nsec": "ns"}
    | {"nanosecond": "ns", "nanoseconds": "ns", "nanos": "ns", "minute": "min", "minutes": "min", "hr": "h"}
    | {"hour": "h", "hours": "h", "day": "d", "days": "d"}
    | {unit: unit for unit in SECONDS}
)
_IN_NAME = re.compile(r"[\[(<{]\s*([^\W\d_]+)\s*[\])>}]\s*$|[_/ ,;:.-]\s*(?:in\s+)?([^\W\d_]+)\s*$", re.IGNORECASE)
_DAYS_FIRST = re.compile(r"\s*(\d{1,2})[./-](\d{1,2})[./-](\d{4}|\d{2})\b")
_ONLY_TIME = re.compile(r"\s*(\d{1,2}):(\d{2}):(\d{2}(?:[.,]\d+)?)\s*")


@dataclass(frozen=True)
class Clock:
    """A uniform grid: rate, time of the first sample, and in words how the stamps were read."""

    rate_hz: float
    t0_s: float
    read_as: str


@dataclass(frozen=True)
class Stamps:
    """Times (n,) in s after an origin, which is whole nanoseconds: long counts keep all their digits."""

    after_s: Array
    origin_ns: int = 0

    def since(self, other: Stamps) -> Array:
        """Return these times (n,) in s after the origin of other ones."""
        return self.after_s + 1e-9 * (self.origin_ns - other.origin_ns)

    @property
    def first_s(self) -> float:
        """The first time in s, to the precision of a double."""
        return float(1e-9 * self.origin_ns + self.after_s[0])


def unit_in(text: str) -> str | None:
    """Return the unit of time at the end of a column's name, or that a cell below it is: `t (ms)`, `t_us`, `time/s`.

    A file's own `hours since 2000-01-01` is one as well.
    """
    plain = text.strip().replace("µ", "u").replace("μ", "u")
    bare = plain.strip("[](){}<>").strip().lower().partition(" since ")[0].strip()
    if bare in _SPELLED:
        return _SPELLED[bare]
    found = _IN_NAME.search(plain)
    written = next((part for part in found.groups() if part), "").lower() if found else ""
    return _SPELLED.get(written)


def is_time_unit(text: str) -> bool:
    """Tell whether a text is a unit of time and nothing else, in brackets or not."""
    return text.strip().strip("[](){}<>").strip().lower().replace("µ", "u").replace("μ", "u") in _SPELLED


def stamps_in(values: NDArray[Any], unit: str) -> Stamps:
    """Return numbers (n,) in a unit of time as times; whole numbers are counted from the first and lose nothing."""
    factor = SECONDS[unit.replace("µ", "u")]
    if values.dtype.kind in "iu" and values.size:
        exact = values.astype(np.int64) if values.dtype.kind == "i" else values.astype(np.uint64)
        return Stamps((exact - exact[0]).astype(np.float64) * factor, int(values[0]) * round(1e9 * factor))
    return Stamps(np.asarray(values, dtype=np.float64) * factor)


def dates(cells: Sequence[str], what: str) -> Stamps:
    """Return dates or times of day (n,) as times; a step back by more than half a day is midnight.

    Raises DataError for a cell that is none, and where day and month are ambiguous.
    """
    import pandas as pd

    clean = [cell.strip().strip('"').replace(",", ".") for cell in cells]
    if _ONLY_TIME.fullmatch(clean[0]):
        found = pd.to_timedelta(pd.Series(clean), errors="coerce")
        found = found + pd.to_timedelta((found.diff() < -pd.Timedelta(hours=12)).cumsum(), unit="D")
    else:
        format_ = _format(clean, what)
        found = pd.to_datetime(pd.Series(clean), format=format_, errors="coerce", utc=True)
        if format_ != "ISO8601":  # whole seconds may be written without their fraction, and others with it
            other = format_.removesuffix(".%f") if format_.endswith(".%f") else f"{format_}.%f"
            found = found.fillna(pd.to_datetime(pd.Series(clean), format=other, errors="coerce", utc=True))
    bad = np.flatnonzero(found.isna())
    if bad.size:
        raise DataError(
            f"{what} holds '{clean[bad[0]][:40]}' in row {bad[0] + 1} of the data, which is not a date: correct it"
        )
    first = found.iloc[0]
    after_s = np.asarray((found - first).dt.total_seconds(), dtype=np.float64)
    return Stamps(after_s, int(first.value))


def _format(cells: Sequence[str], what: str) -> str:
    """Return pandas' name for the format of dates; ISO 8601, or days, months and years in the order the cells show."""
    first = _DAYS_FIRST.match(cells[0])
    if not first:
        return "ISO8601"
    pairs = [(int(m[1]), int(m[2])) for m in map(_DAYS_FIRST.match, cells) if m]
    days_first, months_first = any(a > 12 for a, _ in pairs), any(b > 12 for _, b in pairs)
    sign = cells[0][len(first[1]) + len(cells[0]) - len(cells[0].lstrip())]
    if days_first == months_first and sign != ".":
        raise DataError(f"{what}: '{cells[0]}' may be day or month first: write the dates as 2026-11-25 12:00:00.000")
    order = ("%m", "%d") if months_first and not days_first else ("%d", "%m")
    year = "%Y" if len(first[3]) == 4 else "%y"
    rest = cells[0][first.end() :]
    time = "" if not rest.strip() else (rest[0] + "%H:%M" + ("" if rest.count(":") < 2 else ":%S"))
    return sign.join([*order, year]) + time + (".%f" if "." in rest else "")


def clock_of(stamps: Stamps, what: str, read_as: str) -> Clock:
    """Return the grid of uniform time stamps.

    Raises DataError with the worst step when a stamp leaves the uniform grid by more than 1 % of a sample period.
    """
    time_s = stamps.after_s
    _check_stamps(time_s, what)
    if not _is_uniform(time_s):
        raise DataError(f"{what} is not uniform: {_unevenness(time_s)}")
    return Clock(1.0 / _period_s(time_s), clock_start(stamps), read_as)


def grid_of(stamps: Stamps, what: str, read_as: str) -> tuple[Clock, Array]:
    """Return the clock and the uniform grid (n,) that lies best among uneven stamps, in s after their origin.

    Its period is the middle one of the steps; where rows are lost it goes on over the gap. Raises DataError for stamps
    that do not ascend, and for gaps that are longer than what was measured.
    """
    time_s = stamps.after_s
    ascending(time_s, what)
    steps = np.diff(time_s)
    typical = float(np.median(steps))
    counts = np.maximum(np.round(steps / typical), 1.0)
    if counts.sum() > 2.0 * steps.size + 1000.0:
        longest = int(np.argmax(steps))
        raise DataError(
            f"{what} has gaps of more samples than were measured, the longest of {steps[longest]:.6g} s after sample "
            f"{longest}: import the stretches between gaps as [[parts]]"
        )
    period_s = float((time_s[-1] - time_s[0]) / counts.sum())
    grid = time_s[0] + period_s * np.arange(int(counts.sum()) + 1)
    return Clock(1.0 / period_s, clock_start(stamps), read_as), grid


def ascending(time_s: Array, what: str) -> None:
    """Raise DataError for stamps (n,) that do not ascend or are not finite."""
    _check_stamps(time_s, what)
    steps = np.diff(time_s)
    if not np.all(steps > 0.0):
        raise DataError(f"{what} does not ascend: {_fall(steps)}")


def _fall(steps: Array) -> str:
    """Return in words where stamps do not ascend, and the fix."""
    worst = int(np.argmin(steps))
    return f"the step after sample {worst} is {steps[worst]:.6g} s; put the samples in order, each stamp once"


def resampled(time_s: Array, values: Array, grid_s: Array, method: Method) -> tuple[Array, float]:
    """Return values (n,) on another grid (m,), and about what that costs, as a share of the rms about their mean.

    The cost is measured: stretches as long as the longest gap are left out, every other one, and drawn again from the
    rest. Not-a-number where the record is too short to tell.
    """
    drawn = _drawn(time_s, values, grid_s, method)
    steps, spread = np.diff(time_s), float(np.std(values))
    gap = max(int(np.round(steps.max() / np.median(steps))) - 1, 1)
    left = (np.arange(values.size) // gap) % 2 == 1
    left[-gap:] = False
    if left.sum() < 2 or (~left).sum() < 4:
        return drawn, float("nan")
    if spread == 0.0:
        return drawn, 0.0
    again = _drawn(time_s[~left], values[~left], time_s[left], method)
    return drawn, float(np.sqrt(np.mean((again - values[left]) ** 2))) / spread


def _drawn(time_s: Array, values: Array, at_s: Array, method: Method) -> Array:
    if method == "linear":
        return np.interp(at_s, time_s, values)
    if method == "cubic" and time_s.size >= 4:
        return np.asarray(scipy.interpolate.CubicSpline(time_s, values)(np.clip(at_s, time_s[0], time_s[-1])))
    # a stamp that lies a rounding before the row it belongs to still means that row
    slack = 1e-6 * float(np.median(np.diff(time_s)))
    return values[np.maximum(np.searchsorted(time_s, at_s + slack, side="right") - 1, 0)]


def clock_start(stamps: Stamps) -> float:
    """Return the time of the first sample for the log: none where it is a date, which is not a time of the run."""
    return stamps.first_s if abs(stamps.first_s) < EPOCH_S else 0.0


def _check_stamps(time_s: Array, what: str) -> None:
    if time_s.size < 2:
        raise DataError(f"{what} has {time_s.size} stamps: give at least two")
    wrong = np.flatnonzero(~np.isfinite(time_s))
    if wrong.size:
        raise DataError(f"{what}: stamp {wrong[0] + 1} of {time_s.size} is {time_s[wrong[0]]}: give finite numbers")


def _period_s(time_s: Array) -> float:
    return float((time_s[-1] - time_s[0]) / (time_s.size - 1))


def _is_uniform(time_s: Array) -> bool:
    period_s = _period_s(time_s)
    grid = time_s[0] + period_s * np.arange(time_s.size)
    rounding_s = 4.0 * np.finfo(float).eps * float(np.abs(time_s).max())
    return period_s > 0.0 and bool(np.abs(time_s - grid).max() <= GRID_TOLERANCE * period_s + rounding_s)


def _unevenness(time_s: Array) -> str:
    """Return in words how stamps leave the uniform grid, and what can be done."""
    steps = np.diff(time_s)
    typical = float(np.median(steps))
    if not np.all(steps > 0.0):
        return _fall(steps)
    lost = np.maximum(np.round(steps / typical) - 1.0, 0.0)
    gaps = np.flatnonzero(lost)
    jitter = float(np.abs(steps - typical * (1.0 + lost)).max() / typical)
    worst = int(np.argmax(np.abs(steps - typical)))
    told = (
        f"the step after sample {worst} is {steps[worst]:.6g} s, others are {typical:.6g} s (limit: "
        f"{100.0 * GRID_TOLERANCE:.0f} % of a step off the grid)"
    )
    if gaps.size and jitter < 0.5:
        told = (
            f"{int(lost.sum())} samples are lost in {gaps.size} place(s): the step after sample {gaps[0]} is "
            f"{steps[gaps[0]]:.6g} s, others are {typical:.6g} s"
        )
    return (
        f'{told}; say resample = "cubic" ("linear", "hold") in [log], which states its error, or import the stretches '
        "between gaps as [[parts]]"
    )
