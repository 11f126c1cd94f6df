"""The interlock of every plan: what the coils stand for good, in force (rms) and dissipation.

A feed-forward is predicted before anything moves; what a feedback or learning adds is judged after each segment.
Both are means over the last WINDOW_S, so that a short move may take the peak current, and many in a row may not.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim_backend.bench import Bench, Coil, Limits, Record, Segment
from sim_backend.errors import ConfigError

Array = NDArray[np.float64]

POWER_W = 1.0
"""Mean dissipation of all coils; Table 6.6."""

WINDOW_S = 2.0
"""Time over which force and dissipation are averaged: the period of the paper's slow chop, 0.5 Hz. Assumed: the paper
does not say how long the coils take to warm up."""

BLOCK_S = 0.1
"""The window ends at multiples of this."""


CREDIBLE = 10.0
"""Times its limit beyond which a current or an angle was not read: no amplifier gives it, no axis goes there."""


def credible(read_a: Array, otherwise_a: Array, limits: Limits) -> Array:
    """Return the currents read, replaced by `otherwise_a` where the reading is impossible; shapes (n, n_a)."""
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(read_a) <= CREDIBLE * limits.current_a, read_a, otherwise_a)


def dissipated_w(rms_a: Array, coil: Coil) -> float:
    """Return the mean dissipation of coils that carry `rms_a` (n_a,), a part or whole cycles long; section 6.2.1."""
    return float(np.sum((coil.force_constant_n_a / coil.steepness_n_sqrt_w * rms_a) ** 2))


def overload(rms_a: Array, coil: Coil) -> str:
    """Return which limit coils that carry `rms_a` (n_a,) exceed, by how much; empty where they keep both."""
    power = dissipated_w(rms_a, coil)
    if not power <= POWER_W:
        return f"the coils dissipate {power:.3g} W, the limit is {POWER_W:g} W"
    force = coil.force_constant_n_a * rms_a
    if not np.all(force <= coil.continuous_force_n):
        worst = int(np.argmax(force))
        return f"actuator {worst + 1} gives {force[worst]:.3g} N (rms), the limit is {coil.continuous_force_n:g} N"
    return ""


class RunWatch(Protocol):
    """Judges a run while it is played; `advice` is what to do once it has been stopped."""

    advice: str

    def asked(self, segment: Segment) -> Segment:
        """Return the segment with the channels recorded that the judgement needs."""

    def failure(self, segment: Segment, record: Record) -> str:
        """Return why a played segment must be the last one, empty where it need not."""

    def fallback(self, last: Segment) -> tuple[Segment, int] | None:
        """Return what brings the bench back after `last`, and the cycle that it repeats; None to make it safe now."""


class _Window:
    """Means over the last WINDOW_S of currents as they come; before the first there were none.

    Coils may be overloaded for `allowed_s` in all.
    """

    def __init__(self, coil: Coil, n_actuators: int, rate_hz: float, allowed_s: float) -> None:
        self._coil, self._allowed_s = coil, allowed_s
        self._block = max(round(BLOCK_S * rate_hz), 1)
        self._block_s = self._block / rate_hz
        self._count = max(round(WINDOW_S / self._block_s), 1)
        self._tail = np.zeros((self._count - 1, n_actuators))
        self._begun, self._begun_square = 0, np.zeros(n_actuators)
        self._over_s = 0.0

    def add(self, period_a: Array, n_samples: int) -> str:
        """Add `n_samples` of repeated currents (period, n_a); return why the coils are overloaded, empty if not."""
        blocks = np.concatenate([self._tail, self._whole_blocks(period_a, n_samples)])
        self._tail = blocks[len(blocks) - (self._count - 1) :]
        if len(blocks) < self._count:
            return ""
        mean = np.lib.stride_tricks.sliding_window_view(blocks, self._count, axis=0).mean(axis=-1)
        if not overload(np.sqrt(np.maximum(mean.max(axis=0), 0.0)), self._coil):  # not even the worst of each coil
            return ""
        for one in np.sqrt(np.maximum(mean, 0.0)):
            if why := overload(one, self._coil):
                self._over_s += self._block_s
                if self._over_s > self._allowed_s + 0.5 * self._block_s:
                    return why + (f" for at most {self._allowed_s:g} s in all" if self._allowed_s else "")
        return ""

    def _whole_blocks(self, period_a: Array, n_samples: int) -> Array:
        """Return the mean squares (blocks, n_a) of the blocks that are complete with these currents."""
        period = len(period_a)
        within = np.concatenate([np.zeros((1, period_a.shape[1])), np.cumsum(period_a**2, axis=0)])
        ends = np.append(np.arange(self._block - self._begun, n_samples + 1, self._block), n_samples)
        sums = (ends // period)[:, None] * within[-1] + within[ends % period]
        sums = np.diff(sums, axis=0, prepend=-self._begun_square[None, :])
        # without a complete block what was begun goes on, else it begins with what is left over
        self._begun = self._begun + n_samples if len(sums) == 1 else n_samples - int(ends[-2])
        self._begun_square = sums[-1]
        return np.asarray(sums[:-1] / self._block)


class Forecast:
    """Judges the feed-forward of a run's segments before any of them is played.

    Whole cycles are judged each on its own as well, if they are `by_cycle` while they are played.
    """

    def __init__(self, limits: Limits, rate_hz: float, allowed_s: float, by_cycle: bool) -> None:
        self._limits, self._coil, self._by_cycle = limits, limits.coil, by_cycle
        self._window = None if self._coil is None else _Window(self._coil, len(limits.to_current), rate_hz, allowed_s)

    def require(self, segment: Segment) -> None:
        """Raise ConfigError where the feed-forward of the next segment overloads the coils."""
        if self._coil is None or self._window is None:
            return
        why, over, period_a = "", "a cycle", segment.feedforward @ self._limits.to_current.T
        if self._by_cycle and segment.n_samples >= len(period_a):
            why = overload(np.sqrt(np.mean(period_a**2, axis=0)), self._coil)
        if not why:
            why, over = self._window.add(period_a, segment.n_samples), f"{WINDOW_S:g} s"
        if why:
            raise ConfigError(
                f"segment '{segment.label}': by its feed-forward {why} (mean over {over}); make the waveform smaller "
                "or slower"
            )


class Interlock:
    """Judges each segment of a run by the currents that were measured, else by those that were commanded."""

    advice = "make the waveform smaller or slower, or the feedback weaker"

    def __init__(self, bench: Bench, coil: Coil, allowed_s: float = 0.0) -> None:
        self._limits = bench.limits
        actuators, rate_hz = self._limits.to_current.shape[0], bench.signals[0].sample_rate_hz
        self._window = _Window(coil, actuators, rate_hz, allowed_s)
        self._inputs = tuple(s.name for s in bench.signals if s.role == "input")[: len(bench.axes)]
        measured = tuple(s.name for s in bench.signals if s.role == "aux" and s.unit == "A")
        self._currents = measured if len(measured) == actuators else ()

    def asked(self, segment: Segment) -> Segment:
        """Return the segment with the channels recorded that tell what a feedback or learning adds."""
        if not segment.record or not any(one is not None for one in (*segment.feedback, *segment.learning)):
            return segment
        needed = self._currents or self._inputs
        return replace(segment, record=(*segment.record, *(name for name in needed if name not in segment.record)))

    def failure(self, segment: Segment, record: Record) -> str:
        """Return why a played segment must be the last one, empty where it need not."""
        period_a = segment.feedforward @ self._limits.to_current.T
        for names, to_current in ((self._inputs, self._limits.to_current), (self._currents, None)):
            if names and all(name in record.channels for name in names):
                read = np.stack([record.channels[name] for name in names], axis=1)
                read = read if to_current is None else read @ to_current.T
                period_a = credible(read, period_a[np.arange(len(read)) % len(period_a)], self._limits)
        why = self._window.add(period_a, segment.n_samples)
        return f"segment '{segment.label}': {why} (mean over {WINDOW_S:g} s)" if why else ""

    def fallback(self, last: Segment) -> tuple[Segment, int] | None:
        """Return None: without a strategy there is nothing to go back to."""
        return None
