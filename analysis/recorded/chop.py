"""A recorded chop, by any plan that chops: its phases, cycles and observation windows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.chop import ChopStability, chop_stability, observation_windows
from analysis.power import CoilPower, coil_power
from analysis.settling import Settling, settling
from campaigns.log import LogSegment, Run
from sim_backend.errors import DataError

Array = NDArray[np.float64]

TIP_TILT = ("theta_x", "theta_y")


@dataclass(frozen=True)
class ChopPhase:
    """One phase of a recorded chop (`learning`, `chop` …): rows `start` to `stop`, beginning with whole periods.

    `start` is where the first move to position 2 begins. `commanded_rad` (2, 2) are positions 1 and 2 as (θx, θy).
    """

    run: Run
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
        """Time of the first row after the start of the run."""
        return self.start / self.rate_hz

    def read(self, *names: str) -> Array:
        """Return channels over whole periods as (n, k); raises ConfigError for a channel that was not recorded."""
        stop = self.start + (self.stop - self.start) // self.period * self.period
        return np.stack([self.run.read(name, self.start, stop) for name in names], axis=1)

    def cycles(self, name: str) -> Array:
        """Return a channel as (cycles, period), every period beginning with the move to position 2."""
        return self.read(name)[:, 0].reshape(-1, self.period)

    def windows(self, *names: str) -> Array:
        """Return observation windows (2, cycles, window, k), position 1 first."""
        return observation_windows(self.read(*names), 2, self.dwell, self.window)[::-1]

    def stability(self) -> ChopStability:
        """Return the stability of both positions, computed once; raises DataError when there is no whole period."""
        return self._stability

    @cached_property
    def _stability(self) -> ChopStability:
        return chop_stability(self.windows(*TIP_TILT), self.commanded_rad)

    def moves(self, position: int, dof: str, skip: int = 1) -> Array:
        """Return the mean over cycles, after `skip`, of a dwell (dwell,) at position 1 or 2, its move first.

        Raises DataError when no cycle is left.
        """
        cycles = self.cycles(dof)[skip:]
        if not len(cycles):
            raise DataError(f"{self.run.path}: no cycle is left after the first {skip}; record a longer chop")
        mean = cycles.mean(axis=0)
        return mean[: self.dwell] if position == 2 else mean[self.dwell :]

    def settling(self, dof: str) -> Settling:
        """Return the settling of the mean move to positions 1 and 2, towards what was commanded.

        The mean over cycles is the deterministic part: noise is what the stability counts.
        """
        axis = TIP_TILT.index(dof)
        both = np.stack([self.moves(position, dof) for position in (1, 2)])
        return settling(both, self.rate_hz, self.commanded_rad[:, axis])

    def power(self, force_constant_n_a: float, steepness_n_sqrt_w: float) -> CoilPower:
        """Return dissipation and peak current over whole periods; raises DataError without recorded currents."""
        names = [name for name in self.run.channels if name.startswith("current_")]
        if not names:
            raise DataError(f"{self.run.path} holds no currents; record channels 'current_<actuator>'")
        return coil_power(self.read(*names), force_constant_n_a, steepness_n_sqrt_w, self.period)


def chop_phase(run: Run, phase: str = "chop") -> ChopPhase:
    """Return one phase of a recorded chop; raises DataError when the run has none of that name."""
    parts = [segment for segment in run.segments if segment.settings.get("phase") == phase]
    if not parts:
        raise DataError(f"{run.path} has no phase '{phase}': it is a log of '{run.header.test}', give one of a chop")
    settings = parts[0].settings
    alpha = np.deg2rad(_number(run, parts[0], "alpha_deg"))
    direction = np.array([np.cos(alpha), np.sin(alpha)])
    levels = np.array([_number(run, parts[0], "from_rad"), _number(run, parts[0], "to_rad")])
    return ChopPhase(
        run=run,
        start=parts[0].start + int(settings.get("position_2_at", 0)),
        stop=parts[-1].stop,
        dwell=int(_number(run, parts[0], "dwell_samples")),
        window=int(_number(run, parts[0], "window_samples")),
        commanded_rad=levels[:, None] * direction,
    )


def _number(run: Run, segment: LogSegment, name: str) -> float:
    value: Any = segment.settings.get(name)
    if not isinstance(value, int | float):
        raise DataError(f"{run.path}: segment '{segment.label}' has no setting '{name}'; give the log of a chop")
    return float(value)
