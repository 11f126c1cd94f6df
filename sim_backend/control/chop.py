"""A chop as every strategy needs it: dwells in turn, and what one axis is given during one period of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_backend.bench import Gate
from sim_backend.control.feedforward import StepInput
from sim_backend.control.profile import MotionLimits, fourth_order
from sim_backend.errors import ConfigError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Chop:
    """A periodic chop of one axis: `levels` in output units, each held for `dwell_samples`.

    Every dwell begins with its move. The move into the first level starts from the last, as the period
    repeats. Raises ConfigError when there is no level or a dwell has no sample.
    """

    levels: tuple[float, ...]
    dwell_samples: int
    rate_hz: float

    def __post_init__(self) -> None:
        if not self.levels or self.dwell_samples < 1:
            raise ConfigError(
                f"chop: {len(self.levels)} levels of {self.dwell_samples} samples; it needs one of each at least"
            )

    @property
    def period(self) -> int:
        """Samples in one period."""
        return len(self.levels) * self.dwell_samples

    def moves(self) -> Iterator[tuple[int, float, float]]:
        """Yield (first sample, level before, level after) for every dwell."""
        for i, level in enumerate(self.levels):
            yield i * self.dwell_samples, self.levels[i - 1], level

    def input(self, unit_step: StepInput) -> Array:
        """Return one period (period,) of the input that plays `unit_step` (a move of 1, one input) for every move.

        Raises ConfigError when the move does not fit into a dwell.
        """
        drive, holding = unit_step.drive[:, 0], unit_step.holding[0]
        self._fits(drive.size)
        out = np.empty(self.period)
        for first, before, after in self.moves():
            dwell = out[first : first + self.dwell_samples]
            dwell[:] = holding * after
            dwell[: drive.size] = holding * before + drive * (after - before)
        return out

    def profile(self, limits: MotionLimits) -> Array:
        """Return one period (period,) of the fourth-order reference; ConfigError when a move outlasts its dwell."""
        out = np.empty(self.period)
        for first, before, after in self.moves():
            position = fourth_order(before, after, limits, self.rate_hz).position
            self._fits(position.size)
            dwell = out[first : first + self.dwell_samples]
            dwell[:] = after
            dwell[: position.size] = position
        return out

    def levels_held(self) -> Array:
        """Return one period (period,) of the level of each dwell, without moves between."""
        return np.repeat(np.asarray(self.levels, dtype=float), self.dwell_samples)

    def _fits(self, samples: int) -> None:
        if samples > self.dwell_samples:
            raise ConfigError(
                f"chop: a move of {samples} samples outlasts the dwell of {self.dwell_samples}; slow the chop down"
            )


@dataclass(frozen=True)
class AxisProgram:
    """One period for one axis: `reference` and `feedforward` (period,), and the `gates` of its feedback."""

    reference: Array
    feedforward: Array
    gates: tuple[Gate, ...]
