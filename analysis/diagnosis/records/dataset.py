"""The measured data of a diagnosis: records as arrays, cut into windows, some of them held out of every fit."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.records.lattice import last_place
from sim_backend.errors import DataError
from sim_backend.intersample import steps_for
from sim_backend.linear import Array
from sim_backend.model import Model

Mask = NDArray[np.bool_]

FINEST = 1e-10
"""Part of an output's range that no instrument resolves: 33 bits."""

WARMING_K = 0.02
"""Smallest range of temperatures that counts as one: below it a channel shows its own noise or the drive's warmth."""

_HIDES = 2.0
"""Steps of the largest numbers, as the rms of a noise beside which it is not seen that small numbers have finer ones:
their rounding adds 1/12 of a step squared, 2 % of it."""


_FADES = 1.5
"""Ratio of differences between periods above which the first ones hold more than noise: of 30 samples, noise reaches it
once in a hundred."""


@dataclass(frozen=True)
class Window:
    """Samples `start` to `stop` (exclusive) of a record; `period` in samples, 0 when the excitation does not repeat."""

    label: str
    start: int
    stop: int
    held_out: bool = False
    period: int = 0

    @property
    def repeats(self) -> bool:
        """Whether it holds two whole periods or more."""
        return bool(self.period) and self.stop - self.start >= 2 * self.period

    @property
    def repeated(self) -> tuple[int, int]:
        """Sample in which the first of the whole periods begins that differ by noise alone, and how many they are.

        Of three or more the first is left out, which contains the end of the transient. With fewer than two, the noise
        is unknown.
        """
        whole = (self.stop - self.start) // self.period if self.period else 0
        first = 1 if whole >= 3 else 0
        return self.start + first * self.period, whole - first


def period_within(value: object, rows: int) -> int:
    """Return the period in samples that a setting's `value` states; 0 where it does not fit into so many samples."""
    return int(value) if isinstance(value, int | float) and 1 < value <= rows else 0


@dataclass(frozen=True)
class Record:
    """One unbroken stretch of measurement: `u` (n, n_u), `y` (n, n_y), `temperature_k` (n,) or None.

    A fit multiplies the residuals of its samples by `weight`. In `missing` samples (n,) the readings are no
    measurement, as at the end of a sensor's range. Differences of readings below `finest` (n_y,) are rounding. The
    outputs numbered in `free_zeros` count from an unknown zero. It begins with sample `first_row` of its log.

    Raises DataError when lengths differ or a number is not finite.
    """

    name: str
    u: Array
    y: Array
    windows: tuple[Window, ...]
    temperature_k: Array | None = None
    weight: float = 1.0
    missing: Mask | None = None
    finest: Array | None = None
    free_zeros: tuple[int, ...] = ()
    first_row: int = 0

    def __post_init__(self) -> None:
        if self.u.shape[0] != self.y.shape[0]:
            raise DataError(
                f"record {self.name}: {self.u.shape[0]} samples of the input against {self.y.shape[0]} of the "
                "output; give both the same length"
            )
        for what, values in (("input", self.u), ("output", self.y)):
            if not np.all(np.isfinite(values)):
                row = int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0])
                where = f"record {self.name}: the {what} in sample {row}"
                raise DataError(f"{where} is not a number; leave such samples out")

    @property
    def n(self) -> int:
        """Number of samples."""
        return int(self.u.shape[0])

    @property
    def period(self) -> int:
        """Samples after which a record that is one window repeats; 0 where it does not, or has several windows."""
        return self.windows[0].period if len(self.windows) == 1 else 0

    def left_by(self, reading: Array) -> Array:
        """Return the residual of a simulated reading (n, n_y), interpolated linearly over missing samples.

        Nothing is known there; a residual of its own would pass through every filter into the samples around. White
        noise below any instrument's resolution is added: the residual between two simulations without noise is the
        rounding of numbers, which grows with them and with the motion, and would be taken for an error or a cause.
        """
        left = self.y - reading + self._dither
        if self.missing is not None and not self.missing.all():
            rows, known = np.flatnonzero(self.missing), np.flatnonzero(~self.missing)
            for column in left.T:
                column[rows] = np.interp(rows, known, column[known])
        return left

    @cached_property
    def _dither(self) -> Array:
        """Noise (n, n_y) that hides the rounding of numbers, and no more."""
        if self.finest is None:
            return np.zeros_like(self.y)
        # each output by its own numbers: it has the same noise in a record without the others
        seeds = [zlib.crc32(column.tobytes()) for column in self.y.T]
        own = [np.random.default_rng(seed).standard_normal(self.n) for seed in seeds]
        return np.asarray(self.finest * np.stack(own, axis=1))

    @property
    def fades(self) -> bool:
        """Whether periods differ more at the beginning of a window than at its end, in any output."""
        for w in self.windows:
            if w.period and w.stop - w.start >= 3 * w.period:
                early, late = (self.y[at : at + 2 * w.period] for at in (w.start, w.stop - 2 * w.period))
                first, last = (np.std(pair[w.period :] - pair[: w.period], axis=0) for pair in (early, late))
                if np.any(first > _FADES * last):
                    return True
        return False

    def led_in(self) -> Record:
        """Return a record of whole periods with one more, not fitted, before it; any other record as it is."""
        period = self.period
        if period == 0 or self.n % period:
            return self
        return self._preceded(np.arange(period))

    def after(self, commands: Array) -> Record:
        """Return a record that begins with `commands` (k, n_u) before its own, whose readings belong to no window."""
        first = np.zeros(commands.shape[0], dtype=np.intp)
        return replace(self._preceded(first), u=np.concatenate([commands, self.u]))

    def _preceded(self, rows: NDArray[np.intp]) -> Record:
        """Return a record with these of its `rows` (k,) before its own, in no window."""

        def led(values: NDArray[Any]) -> NDArray[Any]:
            return np.concatenate([values[rows], values])

        return replace(
            self,
            u=led(self.u),
            y=led(self.y),
            windows=tuple(replace(w, start=w.start + rows.size, stop=w.stop + rows.size) for w in self.windows),
            temperature_k=None if self.temperature_k is None else led(self.temperature_k),
            missing=None if self.missing is None else led(self.missing),
        )

    def follows(self, earlier: Record) -> bool:
        """Tell whether this record begins where `earlier` ends in the same log."""
        return earlier.name == self.name and earlier.first_row + earlier.n == self.first_row

    def going_on_from(self, earlier: Record) -> Record:
        """Return `earlier` and this one as one recording."""
        temperatures = [r.temperature_k for r in (earlier, self) if r.temperature_k is not None]
        missing = [np.zeros(r.n, dtype=bool) if r.missing is None else r.missing for r in (earlier, self)]
        shifted = (replace(w, start=w.start + earlier.n, stop=w.stop + earlier.n) for w in self.windows)
        return replace(
            earlier,
            u=np.concatenate([earlier.u, self.u]),
            y=np.concatenate([earlier.y, self.y]),
            windows=(*earlier.windows, *shifted),
            temperature_k=np.concatenate(temperatures) if len(temperatures) == 2 else None,
            missing=np.concatenate(missing),
        )

    def first(self, rows: int) -> Record:
        """Return a record of so many first samples."""
        windows = tuple(replace(w, stop=min(w.stop, rows)) for w in self.windows if w.start < rows)
        return self.cut(0, rows, windows)

    def cut(self, start: int, stop: int, windows: tuple[Window, ...]) -> Record:
        """Return a record of the samples from `start` to before `stop`, with these `windows` of its own samples."""
        rows = slice(start, stop)
        return replace(
            self,
            u=np.ascontiguousarray(self.u[rows]),
            y=np.ascontiguousarray(self.y[rows]),
            windows=windows,
            temperature_k=None if self.temperature_k is None else self.temperature_k[rows],
            missing=None if self.missing is None else self.missing[rows],
            first_row=self.first_row + start,
        )

    def only(self, outputs: NDArray[np.intp]) -> Record:
        """Return a record of these of its outputs (k,)."""
        finest = None if self.finest is None else self.finest[outputs]
        zeros = tuple(k for k, o in enumerate(outputs) if o in self.free_zeros)
        return replace(self, y=np.ascontiguousarray(self.y[:, outputs]), finest=finest, free_zeros=zeros)

    def zeros(self) -> Array:
        """Return what the zeros that nobody knows can add to the readings, one each: (n, n_y, k)."""
        added = np.zeros((self.n, self.y.shape[1], len(self.free_zeros)))
        added[:, list(self.free_zeros), np.arange(len(self.free_zeros))] = 1.0
        return added

    def fitted(self) -> Mask:
        """Return which samples may be used for fitting, shape (n,): inside a window that is not held out."""
        mask = np.zeros(self.n, dtype=bool)
        for w in self.windows:
            mask[w.start : w.stop] = not w.held_out
        return mask

    def held_out(self) -> Mask:
        """Return which samples are held out, shape (n,)."""
        mask = np.zeros(self.n, dtype=bool)
        for w in self.windows:
            mask[w.start : w.stop] = w.held_out
        return mask


@dataclass(frozen=True)
class Dataset:
    """All records of a diagnosis, at one sample rate, with the same inputs and outputs.

    `doubts` say why no cause can be named from them, whatever fits; usually there are none. An `integrating` axis moves
    on without a force, and its errors add up. `beats` are the samples from one reading of each output to the next that
    is new, those of a sensor slower than the log.
    """

    rate_hz: float
    records: tuple[Record, ...]
    doubts: tuple[str, ...] = ()
    integrating: bool = False
    beats: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        # one size for all: noise that is larger where a bench moves more is a cause
        if any(r.finest is None for r in self.records):
            steps = [last_place(column) for column in np.concatenate([r.y for r in self.records]).T]
            finest = np.maximum(FINEST * self.y_scale(), _HIDES * np.array(steps))
            object.__setattr__(self, "records", tuple(replace(r, finest=finest) for r in self.records))

    @property
    def n_outputs(self) -> int:
        """Number of outputs."""
        return int(self.records[0].y.shape[1])

    @property
    def windows(self) -> list[tuple[int, Window]]:
        """Every window that has samples, with the number of its record."""
        return [(i, w) for i, r in enumerate(self.records) for w in r.windows if w.stop > w.start]

    @property
    def judged(self) -> list[tuple[int, Window]]:
        """The windows that are held out, all of them where none is."""
        return [(i, w) for i, w in self.windows if w.held_out] or self.windows

    @property
    def repeats(self) -> bool:
        """Whether any window repeats, so that noise is known from what differs between periods."""
        return any(window.repeats for record in self.records for window in record.windows)

    @property
    def warms(self) -> bool:
        """Whether a temperature was recorded, and changes over the records."""
        known = [r.temperature_k for r in self.records if r.temperature_k is not None]
        return bool(known) and float(np.ptp(np.concatenate(known))) > WARMING_K

    @property
    def noise_rows(self) -> int:
        """How many samples, of one output, differences of periods show of noise alone."""
        return sum(max(w.repeated[1] - 1, 0) * w.period for _, w in self.windows)

    def for_fitting(self) -> Dataset:
        """Return the records of which some samples may be fitted: the others cost time and decide nothing."""
        return replace(self, records=tuple(r for r in self.records if r.fitted().any()))

    def evenly(self) -> Dataset:
        """Return the data for a fit in which every record counts alike: weights are inverse to its output's size.

        Of a periodic record the last period is enough: it differs from the others by noise, which is not looked at. It
        begins where the one before it ends, which is played as well.
        """
        size = [float(np.sqrt(np.mean(np.var(r.y[r.fitted()], axis=0)))) for r in self.records]
        usual = float(np.median(size))
        weights = (usual / own if own > 0.0 else 1.0 for own in size)
        records = (_end(r, weight) for r, weight in zip(self.records, weights, strict=True))
        return replace(self, records=tuple(records))

    def seen_by(self, model: Model) -> Dataset:
        """Return the data with the inputs as the model means them: a band-limited one as the steps that stand for it.

        A record of one periodic window is taken as going on before and after it.
        """
        if model.intersample == "held":
            return self
        records = (replace(r, u=steps_for(r.u, period=r.period)) for r in self.records)
        return replace(self, records=tuple(records))

    def staircase(self) -> Array:
        """Return the rms error (n_y,) of outputs that keep their reading while a slow sensor has none that is new.

        Without its mean lag, which a delay of the model makes up for: a reading is up to b - 1 samples old, evenly
        spread, of b in which it changes by `step`, and that has a variance of step² (b² - 1) / (12 b²).
        """
        out = np.zeros(self.n_outputs)
        for o, beat in enumerate(self.beats):
            step = np.concatenate([r.y[beat:, o] - r.y[:-beat, o] for r in self.records])
            out[o] = np.sqrt(np.mean(step**2) * (beat**2 - 1.0) / 12.0) / beat
        return out

    def y_scale(self) -> Array:
        """Return the rms of each output about its mean over all records, shape (n_y,)."""
        y = np.concatenate([r.y for r in self.records])
        return np.asarray(np.std(y, axis=0), dtype=float)

    def u_scale(self) -> Array:
        """Return the rms of each input over all records, shape (n_u,)."""
        u = np.concatenate([r.u for r in self.records])
        return np.asarray(np.sqrt(np.mean(u**2, axis=0)), dtype=float)


def _end(record: Record, weight: float) -> Record:
    """Return the last two periods of a record that is one periodic window, the last to fit, or any other record whole.

    A start from rest would be wrong by the whole motion. A linear model's start can be projected out; where a mode's
    frequency depends on the level, the rest of the start is as large as what is searched for.
    """
    period = record.period
    if not 0 < period < record.n:
        return replace(record, weight=weight)
    first = max(record.n - 2 * period, 0)
    stop = record.n - first
    windows = (replace(record.windows[0], start=stop - period, stop=stop),)
    return replace(record.cut(first, record.n, windows), weight=weight)
