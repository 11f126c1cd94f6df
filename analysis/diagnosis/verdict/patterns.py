"""Patterns that repeat over position, command or time: searched for in the residual itself.

Any function of the position, or of the command, however fine, is a sum of sinusoids over it, any free-running
disturbance one of sinusoids in time, and any response to the command one of decaying sinusoids after it. The strongest
of each in the residual are tried; that they were chosen among so many is part of their price, and noise is taken to be
as loud as at their neighbours.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np

from analysis.diagnosis.candidates.signature import Motion
from analysis.diagnosis.nominal.responses import no_columns, response
from analysis.diagnosis.verdict.basis import recursion
from sim_backend.assembly import Places
from sim_backend.effects.over_position import READING_DISTANCES
from sim_backend.effects.view import DISTANCES, RecordView
from sim_backend.linear import Array, DiscreteModel

_LEVELS = 2**17
"""Waves over the command among which the strongest is chosen: levels of a command are known to their last digit."""

_REPEATED = 2.0
"""What comes again less often within where the positions mostly are is not a pattern."""

_RUNS = 12
"""A sinusoid in time is searched for in so many of the longest records, each with a phase of its own."""

_PERIODS = 20.0
"""A sinusoid in time of fewer periods is a drift: noise at low frequencies is known from a handful of coefficients."""

_BANDS = 512
"""A sinusoid in time is compared with a narrow band around it: slow noise would be significant in a wide one."""

_DAMPING = (0.005, 0.05)
"""Damping ratios of answers to the command: what rings for long, and what is soon over."""

_ANSWERS = 4
"""The likeliest responses that are tried: those that the model's own modes absorb are among the likeliest as well."""

_LATER = (0.236, 0.472, 0.618, 0.854)
"""Parts of a record by which a command is played later that was not played so: multiples of the golden ratio, which no
number of periods in a record comes near."""

_SWINGS = 3.0
"""Fewest cycles in a record: a slower change of a gain is among the basis functions."""

Signal = Literal["command", "position", "rate"]

_BESIDE = (-2.5, -1.5, 1.5, 2.5)
"""Neighbours of a wave, in cycles over its span: next to nothing of it, and all of the noise that is there."""


@dataclass(frozen=True)
class Pattern(ABC):
    """A repeating pattern at one location: input number `at`, or output number `at` for a `reading`.

    It has `cycles` over the `span`, and was chosen among `choices` patterns.
    """

    reading: bool
    at: int
    cycles: float
    span: float
    choices: int

    @property
    @abstractmethod
    def what(self) -> str:
        """The quantity that the pattern follows, as remarks print it."""

    @property
    def neighbours(self) -> list[Self]:
        """Patterns of neighbouring cycles, which show how strong noise is there."""
        return [replace(self, cycles=self.cycles + by) for by in _BESIDE if self.cycles + by > 1.0]

    @abstractmethod
    def columns(self, motions: Sequence[Motion], record: int, plant: DiscreteModel, places: Places) -> Array:
        """Return k columns (n, n_y, k) that span the change of the outputs in that record at any size and phase."""


@dataclass(frozen=True)
class Wave(Pattern):
    """A wave over a position or the command; the span is where positions mostly are, or the range of the commands."""

    over: Literal["position", "command"]

    @property
    def what(self) -> str:
        """The quantity that the pattern follows, as remarks print it."""
        return f"the {self.over}, over and over"

    def columns(self, motions: Sequence[Motion], record: int, plant: DiscreteModel, places: Places) -> Array:
        """Return the outputs' change (n, n_y, 2) by the wave and a quarter of it later."""
        motion = motions[record]
        if self.over == "command":
            seen = motion.u[:, self.at]
        else:
            seen = motion.sensed[:, self.at] if self.reading else motion.position @ places.coordinates[self.at]
        angle = 2.0 * np.pi * self.cycles / self.span * seen
        out = no_columns(motion.sensed, 2)
        for k, wave in enumerate((np.cos(angle), np.sin(angle))):
            if self.reading:
                out[:, self.at, k] = wave
            else:
                response(plant, wave, self.at, out=out[:, :, k])
        return out


@dataclass(frozen=True)
class Line(Pattern):
    """A sinusoid in time; the span is the median length of a record in seconds.

    Each record has a phase of its own, and so columns of its own: a disturbance is not synchronised with the start of a
    run.
    """

    @property
    def what(self) -> str:
        """The quantity that the pattern follows, as remarks print it."""
        return "time, at one frequency"

    def columns(self, motions: Sequence[Motion], record: int, plant: DiscreteModel, places: Places) -> Array:
        """Return the outputs' change (n, n_y, 2 r) by the wave and a quarter of it later, for r records."""
        motion = motions[record]
        angle = 2.0 * np.pi * self.cycles / self.span / plant.rate_hz * np.arange(motion.u.shape[0])
        own = _longest(motions)
        out = no_columns(motion.sensed, 2 * len(own))
        if record in own:
            k = 2 * own.index(record)
            out[:, self.at, k : k + 2] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return out


@dataclass(frozen=True)
class Modulated(Pattern):
    """A torque proportional to a signal, with a gain that oscillates; the span is that of a `Line`.

    Each record has its own phase, and so its own columns.
    """

    signal: Signal

    @property
    def what(self) -> str:
        """The quantity that the pattern follows, as remarks print it."""
        return f"the {self.signal} with a gain that oscillates"

    def columns(self, motions: Sequence[Motion], record: int, plant: DiscreteModel, places: Places) -> Array:
        """Return the outputs' change (n, n_y, 2 r) by the signal times a wave in time and one a quarter of it later."""
        motion, own = motions[record], _longest(motions)
        out = no_columns(motion.sensed, 2 * len(own))
        if record in own:
            along = {"command": motion.u.T[self.at]}
            along |= {
                k: x @ places.coordinates[self.at] for k, x in (("position", motion.position), ("rate", motion.rate))
            }
            angle = 2.0 * np.pi * self.cycles / self.span / plant.rate_hz * np.arange(motion.u.shape[0])
            for k, wave in enumerate((np.cos(angle), np.sin(angle)), 2 * own.index(record)):
                response(plant, wave * along[self.signal], self.at, out=out[:, :, k])
        return out


@dataclass(frozen=True)
class Ringing(Pattern):
    """What answers the command `played` (an input) at one frequency and dies away with a `damping` ratio.

    Its span is that of all records in seconds. With `later` the command comes later, by that part of the record.
    """

    played: int
    damping: float
    later: float = 0.0

    @property
    def what(self) -> str:
        """The quantity that the pattern follows, as remarks print it."""
        return "past commands, at one frequency"

    @property
    def neighbours(self) -> list[Self]:
        """The same answer to commands that have all frequencies of this one, and were not played."""
        return [replace(self, later=later) for later in _LATER]

    def columns(self, motions: Sequence[Motion], record: int, plant: DiscreteModel, places: Places) -> Array:
        """Return the outputs' change (n, n_y, 2) by the answer, and by its change from sample to sample.

        Whatever has these poles is a sum of the two.
        """
        pole = -self.damping + 1j * np.sqrt(1.0 - self.damping**2)
        z = np.exp(2.0 * np.pi * self.cycles / self.span / plant.rate_hz * pole)
        u = motions[record].u[:, self.played]
        before = np.append(0.0, np.roll(u, round(self.later * u.size))[:-1])  # the command of the sample before
        answer = recursion(before, 1.0, 2.0 * float(z.real), -(abs(z) ** 2))
        out = no_columns(motions[record].sensed, 2)
        out[:, self.at] = np.stack([answer, np.diff(answer, prepend=0.0)], axis=1)
        return out


def patterns_of(views: dict[str, RecordView], places: Places) -> Iterator[Pattern]:
    """Yield the strongest patterns at every location; those in time as errors of a reading, which they resemble."""
    for i, name in enumerate(places.inputs):
        yield from _over_position(views[name], False, i, views[name].force_periods(1))
        yield from _over_command(views[name], i)
        yield from _modulated(views[name], i)
    for o, name in enumerate(places.outputs):
        view = views[name]
        yield from _over_position(view, True, o, view.residual_periods(1))
        if name in places.inputs:
            yield from _ringing(view, o, places.inputs.index(name))
        span_s = _span_s(view)
        for frequency in view.residual_lines_hz(1, _PERIODS / span_s, _BANDS):
            if frequency * span_s > _PERIODS:
                yield Line(True, o, frequency * span_s, span_s, view.residual.size // 2)


def _longest(motions: Sequence[Motion]) -> list[int]:
    """Return the numbers of the longest records, in which something is looked for that has a phase in each."""
    return sorted(range(len(motions)), key=lambda r: -motions[r].u.shape[0])[:_RUNS]


def _span_s(view: RecordView) -> float:
    """Return how long a middling record is."""
    return float(np.median(np.diff((0, *view.ends)))) / view.rate_hz


def _modulated(view: RecordView, at: int) -> Iterator[Pattern]:
    """Yield the torque with an oscillating gain that explains most of the residual."""
    signals: dict[Signal, Array] = {"command": view.u, "position": view.position, "rate": view.rate}
    span_s, choices = _span_s(view), len(signals) * view.residual.size // 2
    found: list[tuple[float, int, Signal]] = []
    least = int(np.ceil(_SWINGS / span_s * view.duration_s))
    for name, signal in signals.items():
        explained = view.modulations(signal)
        explained[:least] = 0.0
        found.append((float(np.max(explained)), int(np.argmax(explained)), name))
    _, cycles, strongest = max(found)
    if cycles >= least:
        yield Modulated(False, at, cycles * span_s / view.duration_s, span_s, choices, strongest)


def _ringing(view: RecordView, at: int, played: int) -> Iterator[Pattern]:
    """Yield the responses to the command with most evidence in the residual."""
    for frequency, damping in view.likely_modes(_ANSWERS, _DAMPING):
        choices = len(_DAMPING) * view.residual.size // 2
        yield Ringing(True, at, frequency * view.duration_s, view.duration_s, choices, played, damping)


def _over_position(view: RecordView, reading: bool, at: int, distances: Sequence[float]) -> Iterator[Pattern]:
    span = view.position_spread
    for distance in distances:
        if span > _REPEATED * distance:
            choices = READING_DISTANCES if reading else DISTANCES
            yield Wave(reading, at, span / distance, span, choices, "position")


def _over_command(view: RecordView, at: int) -> Iterator[Pattern]:
    """Yield the sinusoid over the command with most evidence in the residual, as the input would have to follow it."""
    span = float(np.ptp(view.u)) if view.u.size else 0.0
    if view.wanted is None or not np.any(view.wanted) or not span > 0.0:
        return
    bins = np.minimum(((view.u - np.min(view.u)) / span * 4 * _LEVELS).astype(np.int64), 4 * _LEVELS - 1)
    # twice as many frequencies as whole numbers of waves, so that none falls between two
    agreed = np.abs(np.fft.rfft(np.bincount(bins, weights=view.wanted), 8 * _LEVELS))[: 2 * _LEVELS]
    first = 2 * round(_PERIODS)
    strongest = first + int(np.argmax(agreed[first:]))
    yield Wave(False, at, strongest / 2.0, span, agreed.size, "command")
