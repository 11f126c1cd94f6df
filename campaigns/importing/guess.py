"""A map proposed for files that nobody has described: what is certain, what is guessed, and what is uncertain."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from campaigns.facts.period import period_of
from campaigns.importing.clock import Stamps, clock_of, dates, stamps_in, unit_in
from campaigns.importing.gathering import are_dates
from campaigns.importing.guess_archive import archive_in
from campaigns.importing.guess_names import AUX, AXIS, INPUT, REFERENCE, TIME
from campaigns.importing.isolated import IsolatedSource
from campaigns.importing.sources import Source, open_source
from campaigns.importing.text import TextSource
from campaigns.log.units import is_count, is_unit
from sim_backend.errors import DataError

Array = NDArray[np.float64]

PATHS = (".mat", ".h5", ".hdf5", ".nc", ".tdms")
"""Files whose names are paths."""

_ALL_FITTED = "nothing is held out, so that every sample is fitted and none tests the model"

MOST_TOLD = 20
"""At most so many of the names that are left out are listed."""


@dataclass
class Column:
    """One column of numbers: how it is selected, its values (n,), its unit as far as the file says it."""

    select: str
    values: Array
    unit: str | None
    role: str = ""
    doubts: list[str] = field(default_factory=list)
    last: str = ""
    """Last step of the path that it is selected by, empty where it has none."""

    @property
    def plain(self) -> str:
        """The name without the path before it and its unit."""
        name = self.last or self.select
        return re.sub(r"\s*[\[(].*$", "", name).strip() or name


@dataclass(frozen=True)
class Guess:
    """The text of the map, and in sentences what was guessed and what is uncertain."""

    text: str
    said: tuple[str, ...]


def guess(paths: Sequence[Path], folder: Path) -> Guess:
    """Return a commented map for files of equal columns, the first of which is looked at; several become parts.

    The map is meant for `folder`: files in there or below are named from it. Raises DataError for a file that cannot
    be read or holds no two columns of numbers.
    """
    with ExitStack() as closing:
        source = open_source(paths[0], closing)
        left: list[str] = []
        if isinstance(source, TextSource) and source.dialect.doubt:
            left.append(f"DOUBTFUL: {source.dialect.doubt}")
            source = replace(source, separator=source.dialect.separator, decimal=source.dialect.decimal)
        archive = archive_in(source) if isinstance(source, TextSource) else None
        if archive:
            others = [Column(name, values, None) for name, values in archive.series.items()]
            clock, clock_said, left = archive.lines, [archive.said], [*left, *archive.left]
        else:
            others, clock, clock_said = _table(source, left)
    said = [*clock_said, *_some(left), *_roles(others)]
    period = 0 if archive else period_of({c.select: c.values for c in others if c.role == "input"})
    if period:
        said.append(f"the inputs repeat after {period} samples")
    said.append(_ALL_FITTED)
    text = _text([_from(path, folder) for path in paths], source, others, clock, period)
    return Guess(text, tuple(said))


def _from(path: Path, folder: Path) -> Path:
    """Return a path as a map in `folder` names it."""
    whole = path.resolve()
    return whole.relative_to(folder) if whole.is_relative_to(folder) else whole


def _table(source: Source, left: list[str]) -> tuple[list[Column], str, list[str]]:
    """Return the columns beside the clock, the lines of the map on the clock, and what is to be said about it."""
    columns = _columns(source, left)
    why = f" ({'; '.join(_some(left))})" if left else ""
    if not columns:
        raise DataError(f"{source.path} holds no column of numbers that can be selected: write the map by hand{why}")
    clock, said = _clock(source, columns)
    others = [column for column in columns if column.role != "time"]
    if len(others) < 2:
        raise DataError(
            f"{source.path} holds {len(others)} column(s) beside its clock; an input and an output are needed{why}"
        )
    return others, clock, said


def _some(left: Sequence[str]) -> list[str]:
    """Return the first of what is left out, and how many more there are."""
    return [*left[:MOST_TOLD], *([f"{len(left) - MOST_TOLD} more are left out"] if len(left) > MOST_TOLD else [])]


def _columns(source: Source, left: list[str]) -> list[Column]:
    """Return every one-dimensional run of numbers of the commonest length; tells of those that are left out."""
    found: list[Column] = []
    refused: dict[str, list[str]] = {}  # a line that is too short is an error of every column
    names = source.all_names() if isinstance(source, IsolatedSource) else source.names()
    for k, name in enumerate(names or [""]):
        if not name and names or names.count(name) > 1:
            by_number = f': select = "[:, {k}]" takes it' if isinstance(source, TextSource) else ""
            left.append(f"column {k + 1} is left out, which has no name of its own{by_number}")
            continue
        try:
            values = source.array(name)
        except DataError as error:
            if isinstance(source, TextSource) and are_dates(source.first_cell(name) or ""):
                found.append(Column(name, dates(source.cells(name) or [], name).after_s, "date", "time"))
            else:
                refused.setdefault(str(error), []).append(f"'{name}'")
            continue
        if values is None or values.dtype.kind not in "fiub" or values.ndim > 2 or values.size < 2:
            left.append(f"'{name}' is left out: it is not a column of samples")
            continue
        found += _columns_of(source, name, values)
    left += [f"{', '.join(own)} {'is' if len(own) == 1 else 'are'} left out: {error}" for error, own in refused.items()]
    sizes = [column.values.size for column in found]
    usual = max(set(sizes), key=lambda size: (sizes.count(size), size), default=0)
    left += [
        f"'{column.select}' is left out: it has {column.values.size} samples, most have {usual}"
        for column in found
        if column.values.size != usual
    ]
    return [column for column in found if column.values.size == usual]


def _columns_of(source: Source, name: str, values: NDArray[np.generic]) -> list[Column]:
    """Return the columns of an array of one or two axes, of which the longer one is that of the samples."""
    last = _last_step(source, name)
    if values.ndim == 2 and 1 in values.shape:
        values = values.reshape(-1)
    if values.ndim == 1:
        return [Column(name, np.asarray(values, dtype=np.float64), source.unit(name), last=last)]
    upright = values.shape[0] >= values.shape[1]
    indices = [f"[:, {k}]" if upright else f"[{k}, :]" for k in range(min(values.shape))]
    runs = (values if upright else values.T).astype(np.float64).T
    return [Column(f"{name}{index}", run, None, last=last) for index, run in zip(indices, runs, strict=True)]


def _last_step(source: Source, name: str) -> str:
    """Return what stands behind the last group or structure of a name, empty where its file has neither."""
    kind = source.path.suffix.lower()
    sign = "." if kind == ".mat" else "/"
    return name.rpartition(sign)[2] if kind in PATHS else ""


def _clock(source: Source, columns: list[Column]) -> tuple[str, list[str]]:
    """Return the lines of the map on the clock, and what is to be said about it."""
    for column in columns:
        if column.role != "time" and not TIME.search(column.plain):
            continue
        rising = bool(np.all(np.diff(column.values) > 0.0))
        if not rising:
            continue
        column.role = "time"
        unit = "date" if column.unit == "date" else unit_in(column.unit or "") or unit_in(column.select)
        stamps = Stamps(column.values) if unit == "date" else stamps_in(column.values, unit or "s")
        line = f'time = "{_quoted(column.select)}"\ntime_unit = "{unit or "s"}"'
        doubt = "" if unit else "   # DOUBTFUL: nothing says the unit of time"
        try:
            clock = clock_of(stamps, column.select, "")
        except DataError as error:
            return f'{line}{doubt}\nresample = "cubic"   # the clock is uneven', [
                f"'{column.select}' is the clock and is not uniform: {error}"
            ]
        said = f"'{column.select}' is the clock, in {unit or 's (nothing says the unit)'}: {clock.rate_hz:g} Hz"
        return f"{line}{doubt}", [said]
    return (
        "sample_rate_hz = 1000.0   # DOUBTFUL: no column is a clock; say the true rate",
        ["no column is a clock: correct sample_rate_hz"],
    )


def _roles(columns: list[Column]) -> list[str]:
    said = []
    for column in columns:
        if np.ptp(column.values) == 0.0:
            column.role, note = "aux", "it never changes"
        elif TIME.search(column.plain) and bool(np.all(np.diff(column.values) > 0.0)):
            column.role, note = "aux", "it is another clock"
        elif REFERENCE.search(column.plain):
            column.role, note = "reference", "by its name"
        elif AUX.search(column.plain):
            column.role, note = "aux", "by its name"
        elif INPUT.search(column.plain):
            column.role, note = "input", "by its name"
        else:
            column.role, note = "output", "no name of an input"
        said.append(f"'{column.select}' is taken for {column.role}: {note}")
    usable = [column for column in columns if column.role in ("input", "output")]
    if len(usable) < 2:
        raise DataError(f"{len(usable)} column(s) can be an input or an output; two are needed: write the map by hand")
    if not any(column.role == "input" for column in columns):
        first = usable[0]
        first.role = "input"
        first.doubts.append("nothing says which column is the input; the first is taken")
        said.append(f"DOUBTFUL: nothing says which column is the input, '{first.select}' is taken")
    if not any(column.role == "output" for column in columns):
        last = [column for column in columns if column.role == "input"][-1]
        last.role = "output"
        last.doubts.append("nothing says which column is the output; the last is taken")
        said.append(f"DOUBTFUL: nothing says which column is the output, '{last.select}' is taken")
    return said


def _text(paths: Sequence[Path], source: Source, columns: Sequence[Column], clock: str, period: int) -> str:
    lines = [
        "# A proposal: look at every line, above all at those marked DOUBTFUL, then `mccd import` this map.",
        "[log]",
        'test = "measured"',
    ]
    if len(paths) == 1:
        lines.append(f'source = "{_quoted(str(paths[0]))}"')
    lines += clock.splitlines()
    if isinstance(source, TextSource):
        dialect = source.dialect
        if dialect.separator != " ":
            lines.append(f'delimiter = "{_quoted(dialect.separator)}"')
        lines.append(f'decimal = "{dialect.decimal}"')
    if period:
        lines.append(f"period = {period}   # found on the inputs")
    plain = Counter(column.plain for column in columns)
    taken: set[str] = set()
    lettered = _lettered([column.plain for column in columns if column.role != "aux"])
    rows = 0 if "resample" in clock else columns[0].values.size
    single = all(sum(column.role == role for column in columns) <= 1 for role in ("input", "output"))
    for column in columns:
        called = column.plain if plain[column.plain] == 1 else column.select
        name = re.sub(r"[^\w .-]+", "_", called).strip(" ._-") or "channel"
        while name in taken:
            name += "_"
        taken.add(name)
        known = column.unit is not None and is_unit(column.unit)
        told = f"the file says {_quoted(column.unit)[:40]!r}" if column.unit else "which unit?"
        unit, doubt = (column.unit or "", "") if known else ("1", f"   # DOUBTFUL: {told}")
        if column.unit and is_count(column.unit):
            doubt += "; say the unit of what is counted and, as scale, how much of it one count is"
        lines += ["", f'[channels."{_quoted(name)}"]', f'select = "{_quoted(column.select)}"']
        lines += [f'unit = "{_quoted(unit)}"{doubt}', f'role = "{column.role}"' + _doubtful(column)]
        if column.role != "aux":
            lines.append(f'dof = "{"x" if single else lettered.get(column.plain) or _dof(column)}"')
        low, high = float(column.values.min()), float(column.values.max())
        lines.append(f"# {column.values.size} values from {low:.6g} to {high:.6g}")
        if column.role in ("input", "output") and low == high:
            lines.append("allow_constant = true")
    for path in paths if len(paths) > 1 else ():
        lines += ["", "[[parts]]", f'label = "{_quoted(path.stem)}"', f'source = "{_quoted(str(path))}"']
    return "\n".join([*lines, "", *_held_out(len(paths), rows, period)]) + "\n"


def _held_out(files: int, rows: int, period: int) -> list[str]:
    """Return the comment that offers to hold out the last fifth of `rows`, zero where nobody knows how many there are.

    A sweep has its highest frequencies at the end, so nothing is held out before its owner has decided.
    """
    lines = [f"# {_ALL_FITTED.capitalize()}. To keep some from every fit:"]
    if files > 1:
        return [*lines, "# write held-out into the label of a part."]
    grain = period or 1
    first = (rows - rows // 5) // grain * grain
    if not 0 < first < rows:
        return [*lines, "# name them in [segments]."]
    return [*lines, "# [segments]", f'# "fit" = [0, {first}]', f'# "held-out" = [{first}, {rows}]']


def _doubtful(column: Column) -> str:
    return "".join(f"   # DOUBTFUL: {doubt}" for doubt in column.doubts)


def _lettered(names: Sequence[str]) -> dict[str, str]:
    """Return the axes of names that differ in their last letter alone, as fx, fy, fz, or x, y, z do."""
    own = {name: (name[:-1], name[-1].lower()) for name in names if name[-1:].lower() in ("x", "y", "z")}
    letters = {stem: {letter for other, letter in own.values() if other == stem} for stem, _ in own.values()}
    return {name: letter for name, (stem, letter) in own.items() if len(letters[stem]) > 1}


def _dof(column: Column) -> str:
    """Return the degree of freedom that a name ends with, `x` where it ends with none."""
    found = AXIS.search(column.plain) if len(column.plain) > 1 else None
    return next((part.lower() for part in found.groups() if part), "x") if found else "x"


def _quoted(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"').replace("\t", "\\t")
