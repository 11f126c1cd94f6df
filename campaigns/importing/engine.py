"""The import: read a map, gather and check everything it names, and only then write the log."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from campaigns.facts import RELATIONS, Fact, Seen, found_in, precision, whole
from campaigns.facts.precision import coarsest
from campaigns.facts.resampled import NAME as RESAMPLED
from campaigns.importing.archive import gather_archive
from campaigns.importing.gathering import Files, Part, gather
from campaigns.importing.mapping import ImportMap, PartMap, read_map
from campaigns.importing.record import check_varies
from campaigns.log import Channel, LogSegment, Unit, sha256_of, unit_named
from campaigns.log.guard import one_line
from campaigns.log.limits import check_note
from campaigns.log.schema import to_json
from campaigns.log.units import is_count
from campaigns.log.whole import whole_log
from campaigns.log.write import SETTINGS_BYTES
from campaigns.names import check_label, check_name
from campaigns.progress import Report, part_of, unheard
from campaigns.version import tool_commit
from sim_backend.errors import ConfigError, DataError, MccdError

Array = NDArray[np.float64]
# Two parts of one clock: stamps rounded to 1 % of a period fix the rate of 100 samples to 1e-4.
RATE_AGREEMENT = 1e-4
GATHERING = 0.7
"""Share of the time that reading and checking the sources takes; the log is written in the rest."""


@dataclass(frozen=True)
class ImportReport:
    """What was written: the log, its run, rows and rate, channels in SI and segments.

    `clock` says how the time stamps were read, `remarks` what was noticed.
    """

    path: Path
    run_uid: str
    rows: int
    sample_rate_hz: float
    channels: tuple[Channel, ...]
    segments: tuple[LogSegment, ...]
    clock: str
    remarks: tuple[str, ...]


def import_run(
    map_path: str | os.PathLike[str],
    target: str | os.PathLike[str],
    report: Report = unheard,
    *,
    allow_outside: bool = False,
    note: str = "",
) -> ImportReport:
    """Import what the map at `map_path` names into a new log at `target`; sources count from the map's folder.

    They must lie in there or below, unless `allow_outside`. `note` is written to the log. All data are held in memory
    once. Raises ConfigError for the map and an existing target, DataError for the sources; in both cases nothing is
    written.
    """
    path = Path(map_path)
    check_note(note)
    found, text = read_map(path)
    if Path(target).exists():
        raise ConfigError(f"{target} exists and a log never overwrites: choose another path with --out")
    try:
        units = {name: _unit(name, channel.unit) for name, channel in found.channels.items()}
        wanted: Sequence[PartMap | None] = found.parts or (None,)
        with ExitStack() as closing:
            files = Files(path.parent, found, closing, allow_outside)
            shares = np.linspace(0.0, GATHERING, len(wanted) + 1)
            parts = [
                (gather_archive if found.log.archive else gather)(files, part, units, part_of(report, start, stop))
                for part, start, stop in zip(wanted, shares[:-1], shares[1:], strict=True)
            ]
        for name, channel in found.channels.items():
            check_varies([part.columns[name] for part in parts], name, channel)
        rate_hz = _common_rate(parts)
        segments = _segments(found, parts)
        _check_labels(segments)
        channels = [
            Channel(name, units[name].si, channel.role, channel.dof, rate_hz, parts[0].clock.t0_s)
            for name, channel in found.channels.items()
        ]
        columns = _joined(found, parts)
        rows = sum(part.layout.rows for part in parts)
        seen = Seen(columns, {c.name: c for c in channels}, segments or whole(rows), rate_hz)
        kept = {name: coarsest([part.precisions[name] for part in parts]) for name in found.channels}
        facts = (*(fact for part in parts for fact in part.facts), *found_in(seen), *precision.facts(seen, kept))
        for fact in facts:
            # what has no better value is refused where it is used: import and log keep what was measured
            if fact.refuses_import:
                raise DataError(fact.refusal)
    except MccdError as error:
        kind = next(kind for kind in (DataError, ConfigError, type(error)) if isinstance(error, kind))
        raise kind(one_line(f"{path}: {error}")) from None
    told = part_of(report, GATHERING, 1.0)
    written = _Written(found, _configuration(text, files, facts), note)
    run_uid = _write(Path(target), written, channels, columns, segments, told)
    remarks = [fact.told for fact in facts if fact.remark or fact.name == RESAMPLED]
    read_as = parts[0].clock.read_as
    return ImportReport(Path(target), run_uid, rows, rate_hz, tuple(channels), tuple(segments), read_as, tuple(remarks))


def _unit(name: str, symbol: str) -> Unit:
    check_name(name, "channel")
    if is_count(symbol):
        raise ConfigError(
            f"[channels.{name}] has the unit '{symbol}', which is not a physical unit: say the unit of what is counted "
            'and, as scale, how much of it one count is (unit = "rad", scale = 1.534e-3), or unit = "1" to keep counts'
        )
    try:
        return unit_named(symbol)
    except ConfigError as error:
        raise ConfigError(f"[channels.{name}]: {error}") from None


def _common_rate(parts: list[Part]) -> float:
    first = parts[0].clock.rate_hz
    for part in parts[1:]:
        if abs(part.clock.rate_hz / first - 1.0) > RATE_AGREEMENT:
            raise DataError(
                f"part '{part.label}' runs at {part.clock.rate_hz:.9g} Hz, the first at {first:.9g} Hz: "
                "a log has one rate, import them apart"
            )
    return first


def _segments(found: ImportMap, parts: list[Part]) -> list[LogSegment]:
    period = {} if found.log.period is None else {"period_samples": found.log.period}
    if found.segments:
        return _explicit(found, parts[0].layout.rows, period)
    segments: list[LogSegment] = []
    start = 0
    for part in parts:
        layout = part.layout
        if "period" in found.log.axes:
            period = {"period_samples": layout.samples, "periods": layout.periods}
        length = layout.samples * layout.periods
        for index in range(layout.realisations):
            many = "realisation" in found.log.axes
            words = [part.label, f"realisation {index}" if many else ""]
            label = " ".join(word for word in words if word) or "record"
            settings = dict(part.settings) | period | ({"realisation": index} if many else {})
            segments.append(LogSegment(label, start, start + length, settings))
            start += length
    return segments


def _check_labels(segments: list[LogSegment]) -> None:
    labels = [segment.label for segment in segments]
    for label in labels:
        check_label(label)
        if labels.count(label) > 1:
            raise ConfigError(
                f"segment '{label}' appears {labels.count(label)} times: give each part a label of its own"
            )


def _explicit(found: ImportMap, rows: int, period: Mapping[str, int]) -> list[LogSegment]:
    segments = [LogSegment(label, *span, period) for label, span in found.segments.items()]
    segments.sort(key=lambda segment: segment.start)
    free = 0
    for segment in segments:
        if not segment.start < segment.stop <= rows:
            raise ConfigError(
                f"segment '{segment.label}' is [{segment.start}, {segment.stop}] of {rows} samples: "
                "start must be below stop, and stop at most the number of samples"
            )
        if segment.start < free:
            raise ConfigError(f"segment '{segment.label}' starts at {segment.start} before another ends at {free}")
        free = segment.stop
    return segments


def _joined(found: ImportMap, parts: list[Part]) -> dict[str, Array]:
    """Return every channel of the whole record."""
    if len(parts) == 1:
        return dict(parts[0].columns)
    return {name: np.concatenate([part.columns[name] for part in parts]) for name in found.channels}


def _configuration(text: str, files: Files, facts: Sequence[Fact]) -> str:
    sources = [{"file": name, "sha256": sha256_of(path)} for name, path in sorted(files.used.items())]
    told = [msgspec.to_builtins(fact, enc_hook=lambda number: number.item()) for fact in facts]
    return json.dumps({"map": text, "sources": sources, "facts": told, "asked": list(RELATIONS)}, ensure_ascii=False)


@dataclass(frozen=True)
class _Written:
    """What the header of an imported log comes from."""

    map: ImportMap
    configuration: str
    note: str


def _write(
    target: Path,
    written: _Written,
    channels: list[Channel],
    columns: Mapping[str, Array],
    segments: list[LogSegment],
    report: Report,
) -> str:
    widest = max((len(to_json(segment.settings, segment.label).encode()) for segment in segments), default=0)
    with whole_log(
        target,
        channels,
        test=written.map.log.test,
        bench={"kind": "imported", "name": written.map.log.bench[:256]},
        configuration=written.configuration,
        started_utc=written.map.log.started_utc,
        tool_commit=tool_commit(),
        settings_bytes=max(widest, SETTINGS_BYTES),
        expected_segments=len(segments),
        note=written.note,
    ) as log:
        done = 0
        for segment in segments:
            report(done, segments[-1].stop, f"writing {target.name}")
            log.append({name: column[done : segment.start] for name, column in columns.items()})
            with log.segment(segment.label, segment.settings):
                log.append({name: column[segment.start : segment.stop] for name, column in columns.items()})
            done = segment.stop
        log.append({name: column[done:] for name, column in columns.items()})
        return log.run_uid
