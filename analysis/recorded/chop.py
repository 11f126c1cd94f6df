"""A recorded chop, by any plan that chops: its phases, cycles and observation windows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from analysis.measurements.chop import ChopStability, observation_windows, stability_of_blocks
from analysis.measurements.power import CoilPower, coil_power, joined_power
from analysis.measurements.settling import Settling, settling
from campaigns.log import LogSegment, Run
from campaigns.playing.recording import Recorded
from sim_backend.errors import DataError

Array = NDArray[np.float64]

TIP_TILT = ("theta_x", "theta_y")

VALUES_AT_ONCE = 2_000_000
"""Numbers read together, 16 MB: memory does not grow with the length of a chop."""


R = TypeVar("R", bound=Recorded)


@dataclass(frozen=True)
class ChopOf(Generic[R]):
    """One phase of a recorded chop (`learning`, `chop` …): samples `start` to `stop`, beginning with whole periods.

    `start` is where the first move to position 2 begins. `commanded_rad` (2, 2) are positions 1 and 2 as (θx, θy).
    """

    run: R
    start: int
    stop: int
    dwell: int
    window: int
    commanded_rad: Array

    @property
    def period(self) -> int:
        """Samples in one period."""
        return 2 * self.dwell

    @property
    def rate_hz(self) -> float:
        """Samples per second."""
        return self.run.sample_rate_hz

    @property
    def start_s(self) -> float:
        """Time of the first sample after the start of the run."""
        return self.start / self.rate_hz

    @property
    def n_cycles(self) -> int:
        """Whole periods."""
        return (self.stop - self.start) // self.period

    def read(self, *names: str) -> Array:
        """Return channels over whole periods as (n, k); raises ConfigError for a channel that was not recorded."""
        return self._rows(names, 0, self.n_cycles)

    def cycles(self, name: str) -> Array:
        """Return a channel as (cycles, period), every period beginning with the move to position 2."""
        return self.read(name)[:, 0].reshape(-1, self.period)

    def blocks(self, *names: str) -> Iterator[Array]:
        """Yield channels over whole periods as (n, k), some periods at a time: `VALUES_AT_ONCE`, or a single period."""
        cycles = max(VALUES_AT_ONCE // (self.period * len(names)), 1)
        for first in range(0, max(self.n_cycles, 1), cycles):
            yield self._rows(names, first, min(first + cycles, self.n_cycles))

    def _rows(self, names: Sequence[str], first: int, last: int) -> Array:
        start, stop = (self.start + cycle * self.period for cycle in (first, last))
        columns = [self.run.read(name, start, stop) for name in names]
        return columns[0][:, None] if len(columns) == 1 else np.stack(columns, axis=1)

    def windows(self, *names: str) -> Array:
        """Return observation windows (2, cycles, window, k), position 1 first."""
        return self._windows(self.read(*names))

    def window_means(self, *names: str) -> Array:
        """Return the mean of every observation window (2, cycles, k), position 1 first."""
        return np.concatenate([self._windows(block).mean(axis=2) for block in self.blocks(*names)], axis=1)

    def _windows(self, rows: Array) -> Array:
        return observation_windows(rows, 2, self.dwell, self.window)[::-1]

    def stability(self) -> ChopStability:
        """Return the stability of both positions, computed once; raises DataError when there is no whole period."""
        return self._stability

    @cached_property
    def _stability(self) -> ChopStability:
        return stability_of_blocks(lambda: map(self._windows, self.blocks(*TIP_TILT)), self.commanded_rad)

    def moves(self, position: int, dof: str, skip: int = 1) -> Array:
        """Return the mean over cycles, after `skip`, of a dwell (dwell,) at position 1 or 2, its move first.

        Raises DataError when no cycle remains.
        """
        mean = self._mean_cycle(dof, skip)
        return mean[: self.dwell] if position == 2 else mean[self.dwell :]

    def _mean_cycle(self, dof: str, skip: int) -> Array:
        """Return the mean of a period (period,), the move to position 2 first."""
        if self.n_cycles <= skip:
            raise DataError(f"{self.run.path}: no cycle remains after the first {skip}; record a longer chop")
        total, skipped = np.zeros((1, self.period)), 0
        for block in self.blocks(dof):
            cycles = block.reshape(-1, self.period)
            left_out = min(skip - skipped, len(cycles))
            total = np.concatenate([total, cycles[left_out:]]).sum(axis=0, keepdims=True)
            skipped += left_out
        return total[0] / (self.n_cycles - skip)

    def settling(self, dof: str) -> Settling:
        """Return the settling of the mean move to positions 1 and 2, towards what was commanded.

        The mean over cycles is the deterministic part: noise is what the stability counts.
        """
        axis = TIP_TILT.index(dof)
        mean = self._mean_cycle(dof, skip=1)
        both = np.stack([mean[self.dwell :], mean[: self.dwell]])
        return settling(both, self.rate_hz, self.commanded_rad[:, axis])

    def power(self, force_constant_n_a: float, steepness_n_sqrt_w: float) -> CoilPower:
        """Return dissipation and peak current over whole periods; raises DataError without recorded currents."""
        names = [name for name in self.run.channels if name.startswith("current_")]
        if not names:
            raise DataError(f"{self.run.path} holds no currents; record channels 'current_<actuator>'")
        constants = (force_constant_n_a, steepness_n_sqrt_w, self.period)
        return joined_power((coil_power(block, *constants), len(block)) for block in self.blocks(*names))

    def largest(self, name: str) -> float:
        """Return the largest size of a channel over whole periods."""
        return max(float(np.max(np.abs(block), initial=0.0)) for block in self.blocks(name))


ChopPhase = ChopOf[Run]
"""A phase of a chop that was logged."""


def chop_phase(run: R, phase: str = "chop") -> ChopOf[R]:
    """Return one phase of a recorded chop, read or in memory; raises DataError when the run has none of that name."""
    parts = [segment for segment in run.segments if segment.settings.get("phase") == phase]
    if not parts:
        raise DataError(f"{run.path} has no phase '{phase}'; give the log of a chop")
    settings = parts[0].settings
    alpha = np.deg2rad(_number(run, parts[0], "alpha_deg"))
    direction = np.array([np.cos(alpha), np.sin(alpha)])
    levels = np.array([_number(run, parts[0], "from_rad"), _number(run, parts[0], "to_rad")])
    return ChopOf(
        run=run,
        start=parts[0].start + int(settings.get("position_2_at", 0)),
        stop=parts[-1].stop,
        dwell=int(_number(run, parts[0], "dwell_samples")),
        window=int(_number(run, parts[0], "window_samples")),
        commanded_rad=levels[:, None] * direction,
    )


def _number(run: Recorded, segment: LogSegment, name: str) -> float:
    value: Any = segment.settings.get(name)
    if not isinstance(value, int | float):
        raise DataError(f"{run.path}: segment '{segment.label}' has no setting '{name}'; give the log of a chop")
    return float(value)
