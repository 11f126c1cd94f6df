"""What every cycle of a chop is judged by, and what is played once a cycle has failed.

The host judges, and it does so after each segment: the records of every kind of bench pass there, and no firmware has
to know what learning may do. A segment is one cycle while an input is learned, and two at most else, so that nothing
goes on for longer than three cycles, the one that brings the bench back included.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from campaigns.strategies.overload import CREDIBLE, credible, overload
from campaigns.strategies.stages import learns
from sim_backend.bench import Bench, Gate, Record, Segment, check_segment
from sim_backend.control.blocks import DiscreteFilter
from sim_backend.errors import ConfigError

Array = NDArray[np.float64]

MOST_CYCLES = 3
"""Cycles for which anything may go on that must not be."""

FALLBACK_CYCLES = 1
"""Of these, the ones that bring a bench back before it is made safe."""

CYCLES_AT_ONCE = MOST_CYCLES - FALLBACK_CYCLES
"""Cycles in a segment while nothing is learned."""

STRAY_RAD = 50e-6
"""Error after the step that no chop may keep whose feed-forward knows the move."""

RINGING_S = 0.05
"""Time after which the step of a feed-forward that does not know the cryostat's modes is over. Right after its move it
is up to 72 µrad off on the bench as built, and 34 µrad from then on; on benches with modes 3 % off as well."""

CONVERGED_RAD = 1.7e-6
"""Error (rms over a cycle) that learning need not shrink any further: the band in which a chop has settled."""

FLOOR_RAD = 10.0 * CONVERGED_RAD
"""Error (rms) below which learning need not shrink it: behind a filter it ends at a noise floor, not at zero."""

MOST_MISSING = 0.5
"""Part of a cycle's readings that may be missing."""

PATIENCE = 2
"""Cycles in a row that break the bound of convergence before it counts: noise breaks it once, growth goes on."""


@dataclass(frozen=True)
class Promise:
    """What a strategy promises of a chop.

    `moving` are the axes that move; `shrinks_to` for each of them which part of an error a cycle with gain 1 leaves at
    most, 1 where nothing is proven: then learning may undo STRAY_RAD of what it has achieved. The error of the axes
    `held` stays below STRAY_RAD except while they move, `step_samples` or longer. `feedback` of every axis is what
    brings the bench back: the paper's, for the one in force may be what fails; None where it is unstable as well.
    """

    moving: tuple[int, ...]
    shrinks_to: tuple[float, ...]
    held: tuple[int, ...]
    step_samples: int
    feedback: tuple[DiscreteFilter | None, ...] | None


@dataclass(frozen=True)
class _Cycle:
    """One cycle as it was played: `error_rad` (n_moving,) is rms, `after_rad` (n_held,) the largest after the step.

    Both are of the readings that are numbers; `missing` is the part that are not.
    """

    number: int
    segment: Segment
    command: Array
    current: Array
    error_rad: Array
    after_rad: Array
    missing: float


class Watch:
    """Judges a run cycle by cycle; `axes` are named in what it says."""

    advice = "identify this bench again and design anew"

    def __init__(self, promise: Promise, bench: Bench) -> None:
        self._promise = promise
        self._axes, self._limits = bench.axes, bench.limits
        self._names = {
            role: tuple(s.name for s in bench.signals if s.role == role)[: len(bench.axes)]
            for role in ("input", "output")
        }
        # currents as they were measured, where they are: an amplifier may give less than it is told
        self._names["current"] = tuple(s.name for s in bench.signals if s.role == "aux" and s.unit == "A")
        self._count = 0
        self._strayed = 0
        self._broken = [0] * len(promise.moving)
        self._before: _Cycle | None = None
        self._least = np.full(len(promise.moving), np.inf)
        self._best: _Cycle | None = None

    def asked(self, segment: Segment) -> Segment:
        """Return the segment with the channels recorded that the watch needs."""
        more = [name for names in self._names.values() for name in names if name not in segment.record]
        return replace(segment, record=(*segment.record, *more)) if segment.record and more else segment

    def failure(self, segment: Segment, record: Record) -> str:
        """Return why a played segment must be the last one, empty where it need not; part of a cycle is not judged."""
        for cycle in self._cycles(segment, record):
            if self._before is not None and not _alike(self._before.segment, segment):
                self._before, self._least = None, np.full_like(self._least, np.inf)
            why = self._blind(cycle) or self._overload(cycle) or self._divergence(cycle) or self._stray(cycle)
            if why:
                return f"cycle {cycle.number} ({segment.label}): {why}"
            self._before, self._least = cycle, np.minimum(self._least, cycle.error_rad)
            if self._is_better(cycle):
                self._best = cycle
        return ""

    def fallback(self, last: Segment) -> tuple[Segment, int] | None:
        """Return what brings the bench back after `last`: the drive of the best cycle under the paper's feedback.

        The number of that cycle comes with it. None where no cycle was good, or that feedback is unstable here.
        """
        best, feedback = self._best, self._promise.feedback
        if best is None or feedback is None:
            return None
        moving = list(self._promise.moving)
        shift = _start(last) - _start(best.segment)
        feedforward = last.feedforward.copy()
        feedforward[:, moving] = np.roll(best.command[:, moving], shift, axis=0)
        gates = [gate for gate in last.gates if gate.axis not in moving]
        made = replace(
            last,
            label="fallback",
            n_samples=FALLBACK_CYCLES * last.reference.shape[0],
            feedforward=feedforward,
            feedback=feedback,
            gates=(*gates, *(Gate(0, axis, True, 0.0) for axis in moving)),
            learning=(),
            settings={**last.settings, "phase": "fallback"},
        )
        try:
            check_segment(made, self._limits)
        except ConfigError:
            return None
        return made, best.number

    def _cycles(self, segment: Segment, record: Record) -> Iterator[_Cycle]:
        period, moving, held = segment.reference.shape[0], list(self._promise.moving), list(self._promise.held)
        after = self._after_step(segment)
        for first in range(0, segment.n_samples - period + 1, period):
            rows = slice(first, first + period)
            command, reading = (self._read(record, role, rows) for role in ("input", "output"))
            # beyond many times its end stops an axis was not read
            reading = np.where(np.abs(reading) <= CREDIBLE * self._limits.reference, reading, np.nan)
            error = segment.reference - reading
            known = np.isfinite(error)
            # where an amplifier's reading is missing, what it was told, at least by the feed-forward
            to_current = self._limits.to_current.T
            current = credible(command @ to_current, segment.feedforward @ to_current, self._limits)
            if self._names["current"]:
                current = credible(self._read(record, "current", rows), current, self._limits)
            self._count += 1
            yield _Cycle(
                self._count,
                segment,
                command,
                current,
                _rms(error[:, moving]),
                np.max(np.where(known[:, held], np.abs(error[:, held]), 0.0) * after, axis=0, initial=0.0),
                1.0 - float(known[:, sorted({*moving, *held})].mean(axis=0).min(initial=1.0)),
            )

    def _read(self, record: Record, role: str, rows: slice) -> Array:
        return np.stack([record.channels[name][rows] for name in self._names[role]], axis=1)

    def _after_step(self, segment: Segment) -> Array:
        """Return where in the period (period, n_held) a step is over: 1 there, 0 while the axis moves."""
        starts = [int(segment.settings[f"position_{k}_at"]) for k in (2, 1)]
        period, dwell = segment.reference.shape[0], int(segment.settings["dwell_samples"])
        over = np.zeros((period, len(self._promise.held)))
        for column, axis in enumerate(self._promise.held):
            for start in starts:
                rows = np.arange(start, start + dwell) % period
                way = segment.reference[rows, axis]
                on_the_way = np.flatnonzero(np.abs(way - way[-1]) > 0.1 * CONVERGED_RAD)
                arrival = int(on_the_way[-1]) + 1 if on_the_way.size else 0
                over[rows[max(arrival, self._promise.step_samples) :], column] = 1.0
        return over

    def _blind(self, cycle: _Cycle) -> str:
        if cycle.missing <= MOST_MISSING:
            return ""
        percent, most = 100.0 * cycle.missing, 100.0 * MOST_MISSING
        return f"{percent:.0f} % of the readings of an axis are missing or beyond its reach, the limit is {most:.0f} %"

    def _overload(self, cycle: _Cycle) -> str:
        coil = self._limits.coil
        if coil is None:
            return ""
        return overload(np.sqrt(np.mean(cycle.current**2, axis=0)), coil)

    def _divergence(self, cycle: _Cycle) -> str:
        if self._before is None:
            return ""
        for k, axis in enumerate(self._promise.moving):
            learning = cycle.segment.learning[axis] if axis < len(cycle.segment.learning) else None
            gain = learning.gain if learning is not None and learning.active else None
            if gain == 0.0:  # it listens
                continue
            before, now = self._before.error_rad[k], cycle.error_rad[k]
            bound = self._bound(k, gain or 0.0, before)
            self._broken[k] = 0 if now <= bound else self._broken[k] + 1
            if self._broken[k] >= PATIENCE:
                what = f"learning of {self._axes[axis]} does not converge" if gain else f"{self._axes[axis]} strays"
                return (
                    f"{what}: after {1e6 * before:.3g} µrad the error (rms) is {1e6 * now:.3g} µrad, the limit is "
                    f"{1e6 * bound:.3g} µrad"
                )
        return ""

    def _bound(self, k: int, gain: float, before_rad: float) -> float:
        """Return the largest error (rms) that may follow `before_rad`.

        Where nothing is proven, or learned, it may wander; near the floor of what is learned it must not grow.
        """
        left, wandering = self._promise.shrinks_to[k], self._least[k] + STRAY_RAD
        if left >= 1.0 or not gain:
            return float(wandering)
        proven = 1.0 - gain * (1.0 - left) if before_rad > FLOOR_RAD else 1.0
        return float(min(proven * before_rad + CONVERGED_RAD, wandering))

    def _stray(self, cycle: _Cycle) -> str:
        strays = not np.all(cycle.after_rad <= STRAY_RAD)
        self._strayed = self._strayed + 1 if strays else 0
        # what is still being learned may stray at first, but no longer than it takes to bring the bench back in time
        allowed = MOST_CYCLES - 1 if self._best is None else CYCLES_AT_ONCE - 1
        if not strays or (learns(cycle.segment.learning) and self._strayed <= allowed):
            return ""
        worst = int(np.argmax(cycle.after_rad))
        return (
            f"after its step {self._axes[self._promise.held[worst]]} is off by {1e6 * cycle.after_rad[worst]:.3g} "
            f"µrad, the limit is {1e6 * STRAY_RAD:g} µrad"
        )

    def _is_better(self, cycle: _Cycle) -> bool:
        if not np.all(cycle.after_rad <= STRAY_RAD):
            return False
        return self._best is None or bool(np.linalg.norm(cycle.error_rad) < np.linalg.norm(self._best.error_rad))


def _alike(one: Segment, other: Segment) -> bool:
    """Tell whether the errors of one segment are a measure for the other: same direction, both while learning or not.

    What was learned may be played without the feedback under which it was learned, and then has another error.
    """
    ways = [np.ptp(segment.reference, axis=0) for segment in (one, other)]
    return np.array_equal(*ways) and learns(one.learning) == learns(other.learning)


def _rms(error: Array) -> Array:
    """Return the rms (m,) of the errors (n, m) that are numbers, 0 where none is."""
    known = np.isfinite(error)
    power = np.sum(np.where(known, error, 0.0) ** 2, axis=0) / np.maximum(known.sum(axis=0), 1)
    return np.asarray(np.sqrt(power))


def _start(segment: Segment) -> int:
    return int(segment.settings["position_2_at"])
