"""Patterns that repeat over the position or in time: looked for in the residual, as no few columns hold them all.

Any function of the position, however fine, is a sum of waves over it, and whatever goes on by itself one of waves in
time. The strongest waves of the residual are tried; that they were chosen among so many is part of their price.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.candidates import Motion
from analysis.diagnosis.responses import response
from sim_backend.assembly import Places
from sim_backend.effects.view import RecordView
from sim_backend.linear import DiscreteModel

Array = NDArray[np.float64]

_STRONGEST = 3
"""Waves that are tried per place: the second and third because one of them may be another cause's."""

_DISTANCES = 1024
"""Waves over the position among which the strongest are chosen."""

_PERIODS = 20.0
"""A wave in time of fewer periods is a drift: noise down there is known from a handful of rows."""


@dataclass(frozen=True)
class Pattern:
    """A wave at one place, the number `at` of an input or, as an error of the `reading`, of an output.

    Over the position it repeats after `distance` (unit of the position), in time at `frequency_hz`; the other is zero.
    `choices` is among how many it was chosen.
    """

    reading: bool
    at: int
    choices: int
    distance: float = 0.0
    frequency_hz: float = 0.0

    @property
    def what(self) -> str:
        """What it follows, in words."""
        return "the position, over and over" if self.distance > 0.0 else "time, at one frequency"

    def columns(self, motions: Sequence[Motion], record: int, plant: DiscreteModel, places: Places) -> Array:
        """Return the outputs' change (n, n_y, k) in the record with that number, by the wave and a quarter of it later.

        In time each record has a phase of its own, and so columns of its own: what shakes a bench does not wait for
        the start of a run.
        """
        motion = motions[record]
        if self.frequency_hz > 0.0:
            angle = 2.0 * np.pi * self.frequency_hz / plant.rate_hz * np.arange(motion.u.shape[0])
            out = np.zeros((*motion.sensed.shape, 2 * len(motions)))
            out[:, self.at, 2 * record : 2 * record + 2] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
            return out
        seen = motion.sensed[:, self.at] if self.reading else motion.position @ places.coordinates[self.at]
        angle = 2.0 * np.pi / self.distance * seen
        out = np.zeros((*motion.sensed.shape, 2))
        for k, wave in enumerate((np.cos(angle), np.sin(angle))):
            if self.reading:
                out[:, self.at, k] = wave
            else:
                out[:, :, k] = response(plant, wave, self.at)
        return out


def patterns_of(views: dict[str, RecordView], places: Places) -> Iterator[Pattern]:
    """Yield the strongest waves at every place; those in time as errors of a reading, which they look like as well."""
    for i, name in enumerate(places.inputs):
        for distance in views[name].force_periods(_STRONGEST):
            yield Pattern(False, i, _DISTANCES, distance=distance)
    for o, name in enumerate(places.outputs):
        view = views[name]
        for distance in view.residual_periods(_STRONGEST):
            yield Pattern(True, o, _DISTANCES, distance=distance)
        for frequency in view.residual_lines_hz(_STRONGEST):
            if frequency * view.duration_s > _PERIODS:
                yield Pattern(True, o, view.residual.size // 2, frequency_hz=frequency)
