"""Slow sine loops at several amplitudes, then fed-forward steps at several offsets, open loop (6.2.3)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from campaigns.plans.base import (
    Plan,
    Reach,
    axis_of,
    channels_of,
    on_axis,
    open_loop,
    rate_of,
    rounded,
    smooth_ramp,
)
from campaigns.sizes import samples_of_wave
from sim_backend.bench import Bench, Segment

if TYPE_CHECKING:
    from sim_backend.control.feedforward import StepInput


class Hysteresis(Plan, frozen=True, kw_only=True):
    """Loops of `torques_nm` (N m) at `frequency_hz`, `cycles` each, then steps of `step_rad` from `offsets_rad`.

    The frequency is so low that the phase lag of the damping (0.03 % of a turn of the loop at 0.2 Hz) stays far
    below the remanence sought. A step is the least-norm feed-forward of `move_s` designed on the linear `model`; its
    offset is approached along half a cosine in `ramp_s`, with `settle_s` to come to rest before and after the step.
    All offsets are stepped from `repeats` times, one after the other.
    """

    name: ClassVar[str] = "hysteresis"
    title: ClassVar[str] = "hysteresis loops and steps at offsets"

    axis: str = "theta_x"
    torques_nm: tuple[float, ...] = (0.05, 0.08, 0.095)
    frequency_hz: float = 0.2
    cycles: int = 2
    step_rad: float = 1e-3
    offsets_rad: tuple[float, ...] = (0.0, 3.5e-3, 5.3e-3)
    repeats: int = 1
    move_s: float = 0.005
    ramp_s: float = 0.5
    settle_s: float = 1.0
    model: str = "design-4th-order"

    def __post_init__(self) -> None:
        self.require_positive("frequency_hz", "cycles", "repeats", "move_s", "ramp_s", "settle_s")
        self.require(all(0.0 < t < math.inf for t in self.torques_nm), "torques_nm", "finite torques above zero")
        self.require(all(math.isfinite(o) for o in self.offsets_rad), "offsets_rad", "finite angles")
        self.require(math.isfinite(self.step_rad), "step_rad", "a finite angle")

    def design_models(self) -> tuple[str, ...]:
        """Return the linear model that the steps are designed on."""
        return (self.model,)

    @classmethod
    def offers(cls, bench: Bench, reach: Reach) -> Iterator[Self]:
        """Yield loops of three amplitudes on each axis: slow ones, and ones ten times faster to show what rate does."""
        for axis in reach.axes:
            top = float(reach.command[axis_of(bench, axis)])
            for frequency_hz, cycles in ((1.0, 2), (10.0, 10)):
                yield cls(
                    axis=axis,
                    torques_nm=(rounded(0.3 * top), rounded(0.6 * top), top),
                    frequency_hz=frequency_hz,
                    cycles=cycles,
                    offsets_rad=(),
                )

    def channels(self, bench: Bench) -> tuple[str, ...]:
        """Return commands and readings."""
        return channels_of(bench, ("input", "output"))

    def segments(self, bench: Bench) -> Iterator[Segment]:
        """Yield one segment per loop and three per step; raises ConfigError for an axis or model that does not fit."""
        rate, record = rate_of(bench), self.channels(bench)
        period = samples_of_wave(1.0 / self.frequency_hz, rate)
        self.require_run(bench, len(self.torques_nm) * self.cycles * period, len(self.torques_nm))
        sine = on_axis(bench, self.axis, np.sin(2.0 * np.pi * np.arange(period) / period))
        for i, torque_nm in enumerate(self.torques_nm):
            settings: dict[str, float | str] = {
                "phase": "loop",
                "axis": self.axis,
                "amplitude": torque_nm,
                "period_samples": period,
            }
            yield open_loop(f"loop {i + 1}", torque_nm * sine, self.cycles * period, record, settings)
        if self.offsets_rad:
            yield from self._steps(bench, rate, record)

    def _steps(self, bench: Bench, rate_hz: float, record: tuple[str, ...]) -> Iterator[Segment]:
        from campaigns.strategies.design import Design  # brings all effects: only a plan that is counted needs them

        unit = Design.load(self.model, rate_hz).unit_step(self.axis, samples_of_wave(self.move_s, rate_hz))
        ramp, settle = samples_of_wave(self.ramp_s, rate_hz), samples_of_wave(self.settle_s, rate_hz)
        steps = len(self.offsets_rad) * self.repeats
        self.require_run(bench, steps * 2 * (ramp + settle), 3 * steps)
        for i, offset_rad in enumerate(self.offsets_rad * self.repeats):
            holding = float(unit.holding[0]) * offset_rad
            end = holding + float(unit.holding[0]) * self.step_rad
            there = self._moved(0.0, holding, ramp, settle)
            back = self._moved(end, 0.0, ramp, settle)
            for phase, wave in (("approach", there), ("step", self._step(unit, holding, settle)), ("return", back)):
                settings: dict[str, float | str] = {
                    "phase": phase,
                    "axis": self.axis,
                    "offset_rad": offset_rad,
                    "step_rad": self.step_rad,
                }
                command = on_axis(bench, self.axis, wave)
                yield open_loop(f"{phase} {i + 1}", command, wave.size, record, settings)

    def _moved(self, start: float, stop: float, ramp: int, settle: int) -> np.ndarray:
        way = smooth_ramp(np.array([start]), np.array([stop]), ramp)[:, 0]
        return np.concatenate([way, np.full(settle, stop)])

    def _step(self, unit: StepInput, holding: float, settle: int) -> np.ndarray:
        move = unit.scaled(self.step_rad)
        return holding + np.concatenate([move.drive[:, 0], np.full(settle, float(move.holding[0]))])
