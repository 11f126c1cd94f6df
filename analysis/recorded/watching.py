"""A run seen while it is recorded: what its channels do now, how far a model is off, how long it will take.

The log is opened for reading, without a lock, for each look and closed again, so the writer never waits. What is seen
are the committed samples, which the writer never touches again.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from analysis.linear.simulate import delayed, recur
from campaigns.log import Run, read_run
from sim_backend.errors import ConfigError, DataError
from sim_backend.linear import DiscreteModel, delay_taps, discretise
from sim_backend.model import Model, Port
from sim_backend.readings import with_gaps

Array = NDArray[np.float64]
T = TypeVar("T")

BINS = 48
"""Into how many stretches the recent past of a channel is divided."""

PATIENCE: Final = 5
"""How many looks in a row may fail: one may fall into the moment at which the writer flushes."""


@dataclass(frozen=True)
class Reading:
    """One output over the last seconds: its newest value, its range, and the mean of each of BINS stretches (k,).

    NaN stands where the bench gave no number, or one that no sensor reads.
    """

    name: str
    dof: str
    unit: str
    last: float
    low: float
    high: float
    recent: Array


@dataclass(frozen=True)
class Misfit:
    """Measured minus simulated of one output over the last seconds: its rms, and the output's own about its mean.

    Both are of the samples that hold numbers, NaN where none does.
    """

    name: str
    dof: str
    unit: str
    residual_rms: float
    output_rms: float


@dataclass(frozen=True)
class Snapshot:
    """A run at one moment; `left_s` is of the clock on the wall, None until it is known."""

    run_uid: str
    test: str
    status: str
    status_reason: str
    segment: str
    rows: int
    expected_rows: int | None
    recorded_s: float
    left_s: float | None
    readings: tuple[Reading, ...]
    misfits: tuple[Misfit, ...]
    note: str = ""

    @property
    def running(self) -> bool:
        """Whether the writer lives."""
        return self.status == "running"

    @property
    def samples(self) -> str:
        """How many samples are recorded, and of how many where that is known, in words."""
        if not self.expected_rows:
            return f"{self.rows} samples"
        return f"{self.rows} of {self.expected_rows} samples ({100.0 * self.rows / self.expected_rows:.0f} %)"


class Watch:
    """Looks at the log at `path` again and again; with `model`, also simulates what it should show.

    Of the model its linear part is simulated, from rest at the start of the run: effects are left out, so what they do
    is in the residual. `window_s` is how far back the readings go.
    """

    def __init__(self, path: Path, model: Model | None = None, *, window_s: float = 2.0) -> None:
        self.path, self.model, self.window_s = path, model, window_s
        self._follower: _Follower | None = None
        self._growth = _Growth()
        self._run_uid = ""

    def look(self, now_s: float) -> Snapshot:
        """Return the run as it is; `now_s` is the time of a steady clock.

        Raises DataError for a log that cannot be read, ConfigError when log and model do not match.
        """
        with read_run(self.path) as run:
            return self.seen(run, now_s)

    def seen(self, run: Run, now_s: float) -> Snapshot:
        """Return the run as it is, opened by the caller; one that has replaced another is followed from its start.

        Raises as `look`.
        """
        if run.run_uid != self._run_uid:
            self._follower, self._growth, self._run_uid = None, _Growth(), run.run_uid
        if self.model is not None:
            self._follow(run, self.model)
        start = self.first_row(run)
        segment = run.segments[-1].label if run.segments else ""
        return Snapshot(
            run.run_uid,
            run.header.test,
            run.status,
            run.header.status_reason,
            segment,
            run.rows,
            run.expected_rows,
            run.rows / run.sample_rate_hz,
            self._left(run, now_s),
            tuple(_reading(run, name, start) for name in run.names("output")) if run.rows > start else (),
            self._follower.misfits(run, start) if self._follower is not None and run.rows > start else (),
            run.header.note,
        )

    def first_row(self, run: Run) -> int:
        """Return the number of the first sample of the last `window_s` seconds of a run."""
        return max(0, run.rows - round(self.window_s * run.sample_rate_hz))

    def simulated(self, name: str, rows: int) -> Array | None:
        """Return the newest samples (n,) of an output as simulated at the last look, None where there are none."""
        follower = self._follower
        ports = [] if follower is None else [port for port, own in follower.outputs.items() if own == name]
        return follower.simulated[-rows:, ports[0]] if follower is not None and ports else None

    def _follow(self, run: Run, model: Model) -> None:
        if self._follower is None:
            self._follower = _Follower(run, model, round(self.window_s * run.sample_rate_hz))
        self._follower.advance(run)

    def _left(self, run: Run, now_s: float) -> float | None:
        self._growth.add(now_s, run.rows)
        if run.status != "running":
            return 0.0
        return None if run.expected_rows is None else self._growth.left_s(run.expected_rows, now_s)


@dataclass(frozen=True)
class _Grown:
    """New samples: by when they were there, how long before that nobody had looked, and how many there were then."""

    at_s: float
    unseen_s: float
    rows: int


class _Growth:
    """How fast a log grows, from the moments at which new samples were seen: between them it stands still."""

    def __init__(self) -> None:
        self._seen: tuple[float, int] | None = None
        self._first: _Grown | None = None
        self._last: _Grown | None = None
        self._longest_s = 0.0

    def add(self, now_s: float, rows: int) -> None:
        """Note how many samples there are now."""
        if self._seen is not None and rows > self._seen[1]:
            grown = _Grown(now_s, now_s - self._seen[0], rows)
            self._first = self._first or grown
            self._longest_s = max(self._longest_s, now_s - (self._last or grown).at_s)
            self._last = grown
        self._seen = now_s, rows

    def left_s(self, expected: int, now_s: float) -> float | None:
        """Return how long `expected` samples take from now; None until that is known within a factor of two.

        It is not before samples came twice, the times of which are known to half of what passed between them, nor where
        samples are overdue by twice the longest time between any.
        """
        first, last = self._first, self._last
        if first is None or last is None or last.rows == first.rows:
            return None
        passed = last.at_s - first.at_s
        if passed < 2.0 * max(first.unseen_s, last.unseen_s) or now_s - last.at_s > 2.0 * self._longest_s:
            return None
        whole = max(expected - last.rows, 0) * passed / (last.rows - first.rows)
        return max(whole - (now_s - last.at_s), 0.0)


class _Follower:
    """Simulates a linear model along a growing log, each sample once, and keeps the last seconds of what it gives."""

    def __init__(self, run: Run, model: Model, window: int) -> None:
        self.inputs, self.outputs = _channels(run, model.inputs, "input"), _channels(run, model.outputs, "output")
        self.plant: DiscreteModel = discretise(model.linear(), run.sample_rate_hz)
        self.row = 0
        self._state = np.zeros((self.plant.a.shape[0], 2))
        # a delayed input needs the samples before the block
        reach = max(delay_taps(float(delay)).reach for delay in self.plant.delay_samples)
        self._past = np.zeros((reach, len(model.inputs)))
        self._window = max(window, 1)
        self.simulated = np.zeros((0, len(model.outputs)))

    def advance(self, run: Run) -> None:
        for _, block in run.blocks(self.inputs.values(), start=self.row):
            # what is not recorded, or no number, was not driven as far as anybody knows
            u = np.zeros((next(iter(block.values())).size, self._past.shape[1]))
            for port, name in self.inputs.items():
                u[:, port] = np.nan_to_num(with_gaps(block[name]))  # else all that follows were no number either
            self.simulated = np.concatenate([self.simulated, self._simulate(u)])[-self._window :]
            self.row += u.shape[0]

    def misfits(self, run: Run, start: int) -> tuple[Misfit, ...]:
        found = []
        for k, name in self.outputs.items():
            measured = with_gaps(run.stored(name, start, self.row))
            residual = measured - self.simulated[-measured.size :, k]
            channel = run.channels[name]
            own = _rms(measured - _mean(measured))
            found.append(Misfit(name, channel.dof or name, channel.unit, _rms(residual), own))
        return tuple(found)

    def _simulate(self, u: Array) -> Array:
        plant, m = self.plant, self.plant.a.shape[0]
        whole = np.concatenate([self._past, u])
        drive = np.ascontiguousarray(delayed(whole, plant.delay_samples)[self._past.shape[0] :].T)
        self._past = whole[-self._past.shape[0] :]
        states = (plant.b.reshape(2 * m, -1) @ drive).reshape(m, 2, -1)
        recur(plant.a, states, self._state)
        output = plant.c.reshape(-1, 2 * m) @ states.reshape(2 * m, -1) + plant.d @ drive
        return np.ascontiguousarray(output.T)


def _channels(run: Run, ports: Sequence[Port], role: str) -> dict[int, str]:
    """Return the channel of every port that was recorded, by the port's number: of its name, else of its dof."""
    names = run.names(role)
    found = {}
    for k, port in enumerate(ports):
        same = [n for n in names if n == port.name] or [n for n in names if run.channels[n].dof == port.dof]
        if same and run.channels[same[0]].unit == port.unit:
            found[k] = same[0]
    if not found:
        have = ", ".join(f"{n} ({run.channels[n].unit})" for n in names) or "none"
        want = ", ".join(f"{p.name} ({p.unit})" for p in ports)
        raise ConfigError(f"{run.path}: no {role} channel fits the model, which has {want}; the log has {have}")
    return found


def _reading(run: Run, name: str, start: int) -> Reading:
    values = with_gaps(run.stored(name, start))
    channel = run.channels[name]
    recent = np.array([_mean(part) for part in np.array_split(values, min(BINS, values.size))])
    there = values[np.isfinite(values)]
    low, high = (float(there.min()), float(there.max())) if there.size else (np.nan, np.nan)
    return Reading(name, channel.dof, channel.unit, float(values[-1]), low, high, recent)


def _mean(values: Array) -> float:
    """Return the mean of what was read, NaN where nothing was."""
    there = values[np.isfinite(values)]
    return float(there.mean()) if there.size else np.nan


def _rms(values: Array) -> float:
    return float(np.sqrt(_mean(values**2)))


def patiently(look: Callable[[], T], path: Path) -> T:
    """Return what a look at the log at `path` gives, tried up to PATIENCE times more; raises what the last one did."""
    for _ in range(PATIENCE):
        try:
            return look()
        except DataError:
            if not path.exists():
                raise
            time.sleep(0.05)
    return look()
