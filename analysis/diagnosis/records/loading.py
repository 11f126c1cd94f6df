"""Logs → Dataset: channels found by the model's ports, segments as windows, memory bounded, every caveat noted.

What one bench recorded without a break stays one record, because the motion continues from segment to segment.
Realisations of an import are records of their own, and so are its parts unless their motion shows that they were one
recording (the fact *unbroken*): the state at the start of each is unknown.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from analysis.diagnosis.nominal.tuning import nuisances_of
from analysis.diagnosis.records.checks import (
    MIN_ROWS,
    check_enough,
    check_inputs,
    check_outputs,
    without_copies,
    without_cut_off,
)
from analysis.diagnosis.records.dataset import Dataset, Record, Window, period_within
from analysis.diagnosis.records.holding import with_held_out
from campaigns.facts import Fact, facts_of, remarks_on, usable_segments
from campaigns.facts.unbroken import NAME as UNBROKEN
from campaigns.log import Run, read_run, sha256_of, unit_named
from sim_backend.errors import ConfigError, DataError
from sim_backend.linear import Array
from sim_backend.model import Model, Port

MAX_ROWS = 250_000
"""Samples that are used by default. Of longer logs, pieces of each segment are used, or of some of very many segments.
A full campaign has half as many; memory and time grow with them, 2.6 GB and 20 minutes for a million."""

MAX_PRODUCTS = 10_000_000
"""Samples times adjustable parameters of the model that are used: the cost of their derivatives in memory and time."""

RATE_AGREEMENT = 1e-6

_FEWEST = 3
"""Realisations, or windows, of each kind that are taken at least."""

_ENOUGH = 0.8
"""Part of the shortest useful pieces of all windows that must fit into the samples; else windows are left out."""


@dataclass(frozen=True)
class Source:
    """One file of a diagnosis: its path as given, checksum, run, number of samples used and note of the log."""

    file: str
    sha256: str
    run_uid: str
    rows: int
    note: str = ""


@dataclass(frozen=True)
class Loaded:
    """The data of a diagnosis, the files they came from, and what a reader has to know about both."""

    data: Dataset
    sources: tuple[Source, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Stretch:
    """Samples `start` to `stop` of a run that follow one another, with the windows in them (samples of the run)."""

    start: int
    stop: int
    windows: tuple[Window, ...]


def load_runs(paths: Sequence[str | Path], model: Model, *, max_rows: int = MAX_ROWS) -> Loaded:
    """Return the records of all logs at `paths` with their channels in the order of the model's ports.

    Segments whose label contains "held-out" are kept from every fit; without any, some are chosen and a note says so.
    Raises ConfigError when model and channels do not match or a run is given twice, DataError for a log that cannot be
    used: too few samples, a constant or saturated channel, numbers that are not finite, sample rates that differ.
    """
    if not paths:
        raise ConfigError("no log was given; give at least one RUN.h5")
    runs: list[Run] = []
    try:
        for path in paths:
            runs.append(read_run(path))
            if not runs[-1].rows:
                raise DataError(f"{path} holds no samples; give a run in which something was recorded")
        return _load(runs, model, max_rows)
    finally:
        for run in runs:
            run.close()


def _load(runs: Sequence[Run], model: Model, max_rows: int) -> Loaded:
    rate_hz = _common_rate(runs)
    max_rows = min(max_rows, max(MAX_PRODUCTS // max(len(nuisances_of(model.linear(), 1.0)), 1), MIN_ROWS))
    matches = [match_channels(run, model) for run in runs]
    stretches = [_stretches(run) for run in runs]
    total = sum(s.stop - s.start for per_run in stretches for s in per_run)
    notes = [note for match in matches for note in match.notes]
    notes += [
        f"{run.path.name} ended as {run.status} ({run.header.status_reason or 'no reason given'}); "
        "what was recorded until then is used"
        for run in runs
        if run.status != "complete"
    ]
    if total > max_rows:
        share = max_rows / total
        if all(w.period for per_run in stretches for s in per_run for w in s.windows) and all(map(_many, stretches)):
            notes.append(f"{total} samples were recorded; one realisation in {round(1 / share)} is used, of every kind")
            stretches = [_some(per_run, share) for per_run in stretches]
        else:
            segments = sum(len(s.windows) for per_run in stretches for s in per_run)
            pieces = [_thinned(per_run, share) for per_run in stretches]
            used = sum(map(len, pieces))
            where = "spread over every segment" if used == segments else f"in {used} of {segments} segments"
            notes.append(f"{total} samples were recorded; about {max_rows} of them are used, {where}")
            stretches = [[piece for own in per_run for piece in own] for per_run in pieces]
    warm = all(match.temperature is not None for match in matches)
    records: list[Record] = []
    sources: list[Source] = []
    for run, match, per_run in zip(runs, matches, stretches, strict=True):
        found = [_read(run, match, s, warm) for s in per_run]
        check_outputs(found, match.outputs, str(run.path))
        found, cut = without_cut_off(found, match.outputs, facts_of(run))
        notes += cut
        records += found
        sources.append(
            Source(str(run.path), sha256_of(run.path), run.run_uid, sum(r.n for r in found), run.header.note)
        )
    notes += check_inputs(records, [p.name for p in model.inputs])
    different, copies = without_copies(records, [p.name for p in model.outputs])
    held, note = with_held_out(different)
    check_enough(held, ", ".join(str(run.path) for run in runs))
    notes += copies
    integrating = bool(np.any(model.linear().omega_rad_s == 0.0))
    data = Dataset(rate_hz, held, _doubts(runs, matches), integrating, _beats(runs, matches)).seen_by(model)
    notes += [remark for remark in remarks_on(runs) if "cut off" not in remark]  # noted above, with the samples used
    return Loaded(data, tuple(sources), (*notes, *([note] if note else [])))


def _doubts(runs: Sequence[Run], matches: Sequence[Match]) -> tuple[str, ...]:
    """Return why no cause can be named from these logs, whatever fits them."""
    told = [
        f"{run.path.name}: {fact.finding}; what a staircase adds above half its rate looks like resonances and noise"
        for run, _, fact in _slow_sensors(runs, matches)
    ]
    return tuple(dict.fromkeys(told))


def _beats(runs: Sequence[Run], matches: Sequence[Match]) -> tuple[int, ...]:
    """Return after how many samples each output has a new reading, one where its sensor keeps up."""
    beats = [1] * len(matches[0].outputs)
    for _, o, fact in _slow_sensors(runs, matches):
        beats[o] = max(beats[o], int(fact.numbers["every"]))
    return tuple(beats)


def _slow_sensors(runs: Sequence[Run], matches: Sequence[Match]) -> list[tuple[Run, int, Fact]]:
    """Return every fact of an output's sensor that is slower than the log, with its run and the output's number."""
    return [
        (run, match.outputs.index(fact.channel), fact)
        for run, match in zip(runs, matches, strict=True)
        for fact in facts_of(run)
        if fact.name == "slow-sensor" and fact.channel in match.outputs
    ]


def _common_rate(runs: Sequence[Run]) -> float:
    seen: dict[str, Path] = {}
    for run in runs:
        if run.run_uid in seen:
            raise ConfigError(f"{run.path} and {seen[run.run_uid]} are the same run {run.run_uid}; give each run once")
        seen[run.run_uid] = run.path
        first = runs[0].sample_rate_hz
        if abs(run.sample_rate_hz / first - 1.0) > RATE_AGREEMENT:
            raise DataError(
                f"{run.path} was sampled at {run.sample_rate_hz:.9g} Hz, {runs[0].path} at {first:.9g} Hz; "
                "a diagnosis has one rate, diagnose them apart"
            )
    return runs[0].sample_rate_hz


def _stretches(run: Run) -> list[_Stretch]:
    windows = [
        Window(s.label, s.start, s.stop, s.held_out, period_within(s.settings.get("period_samples"), s.stop - s.start))
        for s in usable_segments(run)
        if s.rows
    ]
    if not windows:
        windows = [Window("record", 0, run.rows)]
    goes_on = _going_on(run, windows)
    stretches: list[_Stretch] = []
    for w in windows:
        if stretches and w.start in goes_on:
            stretches[-1] = _Stretch(stretches[-1].start, w.stop, (*stretches[-1].windows, w))
        else:
            stretches.append(_Stretch(w.start, w.stop, (w,)))
    return stretches


def _going_on(run: Run, windows: Sequence[Window]) -> set[int]:
    """Return where windows start that go on with the recording of the one before."""
    realisations = any("realisation" in s.settings for s in run.segments)
    if not _joined_by_a_map(run) and not (realisations and run.header.bench.get("kind") == "imported"):
        return {w.start for w in windows}
    told = () if realisations else facts_of(run)
    found = {fact.numbers.get("start") for fact in told if fact.name == UNBROKEN and fact.numbers.get("found")}
    return {after.start for before, after in pairwise(windows) if before.stop == after.start and after.start in found}


def _joined_by_a_map(run: Run) -> bool:
    """Tell whether an import made one log of parts, each of which may have been recorded by itself."""
    try:
        text = json.loads(run.header.configuration).get("map", "")
        return "parts" in tomllib.loads(text)
    except (ValueError, AttributeError, TypeError):  # not the configuration of an import
        return False


def _many(stretches: Sequence[_Stretch]) -> bool:
    """Tell whether a run is many independent stretches of one segment each, as realisations are."""
    return len(stretches) > 6 and all(len(s.windows) == 1 for s in stretches)


def _some(stretches: Sequence[_Stretch], share: float) -> list[_Stretch]:
    """Return evenly chosen ones of those to fit and of those held out, at least three of each if there are."""
    chosen: list[_Stretch] = []
    for held in (False, True):
        group = [s for s in stretches if s.windows[0].held_out is held]
        count = min(max(round(share * len(group)), _FEWEST), len(group))
        at = (np.arange(count) + 0.5) * len(group) / max(count, 1)
        chosen += [group[int(i)] for i in at]
    return chosen


def _thinned(stretches: Sequence[_Stretch], share: float) -> list[list[_Stretch]]:
    """Return pieces of each window of a run, which have together about `share` of its samples.

    Where even the least that is of use in every window would be too much, evenly chosen windows have to do.
    """
    windows = [w for s in stretches for w in s.windows]
    pieces = [_pieces(w, share) for w in windows]
    wanted = share * sum(w.stop - w.start for w in windows)
    part = wanted / sum(piece.stop - piece.start for own in pieces for piece in own)
    if part < _ENOUGH:
        kept = {s.start for s in _some([own[0] for own in pieces], part)}
        pieces = [own for own in pieces if own[0].start in kept]
    return pieces


def _pieces(w: Window, share: float) -> list[_Stretch]:
    """Return three pieces of a window, at its beginning, middle and end, together `share` of its samples.

    Of a short one there is a single piece, of two periods where it has them: what differs between them is noise. It
    lies at the end, when what was left of an earlier motion has died out.
    """
    rows = w.stop - w.start
    step = max(w.period, 1)
    size = int(share * rows / 3.0) // step * step
    if size < max(MIN_ROWS, 2 * w.period):
        size = min(max(int(share * rows) // step * step, 2 * w.period, MIN_ROWS), rows)
        return [_Stretch(w.stop - size, w.stop, (replace(w, start=w.stop - size),))]
    middle = w.start + ((rows - size) // 2) // step * step
    last = w.start + (rows - size) // step * step
    places = (("beginning", w.start), ("middle", middle), ("end", last))
    return [
        _Stretch(at, at + size, (replace(w, label=f"{w.label}, {name}", start=at, stop=at + size),))
        for name, at in places
    ]


def _read(run: Run, match: Match, s: _Stretch, warm: bool) -> Record:
    names = [*match.inputs, *match.outputs, *([match.temperature] if warm and match.temperature else [])]
    values = np.stack([run.read(name, s.start, s.stop) for name in names], axis=1)
    check_finite(values, names, str(run.path), s.start)
    n_u, n_y = len(match.inputs), len(match.outputs)
    windows = tuple(replace(w, start=w.start - s.start, stop=w.stop - s.start) for w in s.windows)
    return Record(
        run.run_uid,
        np.ascontiguousarray(values[:, :n_u]),
        np.ascontiguousarray(values[:, n_u : n_u + n_y]),
        windows,
        np.ascontiguousarray(values[:, -1]) if len(names) > n_u + n_y else None,
        first_row=s.start,
    )


@dataclass(frozen=True)
class Match:
    """Names of a run's channels in the order of the model's ports; `temperature` is None when it was not recorded."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    temperature: str | None
    notes: tuple[str, ...]


def match_channels(run: Run, model: Model) -> Match:
    """Return which channels of `run` are the model's ports: by the port's name, else by its degree of freedom.

    Raises ConfigError naming the port and the channels there are when a port has no channel, several, or one in
    another unit.
    """
    inputs = tuple(_channel_of(run, port, "input") for port in model.inputs)
    outputs = tuple(_channel_of(run, port, "output") for port in model.outputs)
    kelvin = [n for n in run.names("aux") if run.channels[n].unit == "K"]
    named = [n for n in kelvin if n.startswith("temperature")] or kelvin
    notes = []
    for role, used in (("input", inputs), ("output", outputs)):
        left = [n for n in run.names(role) if n not in used]
        if left:
            counts = "what these move counts as an error of the model" if role == "input" else "these are not judged"
            notes.append(f"{run.path.name}: the model has no {role} for {', '.join(left)}; {counts}")
    if len(named) > 1:
        notes.append(f"{run.path.name}: of {', '.join(named)} the temperature used is {named[0]}")
    return Match(inputs, outputs, named[0] if named else None, tuple(notes))


def _channel_of(run: Run, port: Port, role: str) -> str:
    names = run.names(role)
    found = [n for n in names if n == port.name] or [n for n in names if run.channels[n].dof == port.dof]
    have = ", ".join(f"{n} ({run.channels[n].dof or 'no dof'})" for n in names) or "none"
    if len(found) != 1:
        many = f"{len(found)} {role} channels" if found else f"no {role} channel"
        raise ConfigError(
            f"{run.path}: {many} for the model's {role} '{port.name}' (dof {port.dof}); it has {have}: give a model of "
            "these channels, or name them in the import map as the model does"
        )
    unit, wanted = run.channels[found[0]].unit, unit_named(port.unit)
    if wanted.si != unit or wanted.symbol != wanted.si:
        raise ConfigError(
            f"{run.path}: channel '{found[0]}' is in {unit}, the model's {role} '{port.name}' in {port.unit}; "
            "logs are in SI: write the model in the same unit"
        )
    return found[0]


def check_finite(values: Array, names: Sequence[str], file: str, first_row: int) -> None:
    """Raise DataError naming file, channel and sample when `values` (n, k) hold a number that is not finite."""
    bad = np.argwhere(~np.isfinite(values))
    if bad.size:
        row, column = int(bad[0][0]), int(bad[0][1])
        raise DataError(
            f"{file}: channel '{names[column]}' holds {values[row, column]} in sample {first_row + row}, and "
            f"{len(bad)} value(s) in all are not finite; repair them or import the stretches between them"
        )
