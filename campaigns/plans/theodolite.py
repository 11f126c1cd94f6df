"""Hold a grid of angles for an independent instrument to read: the gain of the position sensors (6.2.1)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import ClassVar, Self

import numpy as np

from campaigns.plans.base import Plan, Reach, axis_of, channels_of, rate_of, rounded, smooth_ramp
from campaigns.sizes import samples_of, samples_of_wave
from sim_backend.bench import Bench, Gate, Segment


class Theodolite(Plan, frozen=True, kw_only=True):
    """Go to every pair of `x_rad` and `y_rad` within `radius_rad` in closed loop, wait `settle_s`, hold for `hold_s`.

    The reference moves along half a cosine in `move_s`. A bench with an instrument of its own has channels
    `theodolite_<axis>`, which are recorded; readings of another instrument are paired with the grid by their order.
    """

    name: ClassVar[str] = "theodolite"
    title: ClassVar[str] = "sensor gain against a theodolite"

    x_rad: tuple[float, ...] = (-8e-3, -4e-3, 0.0, 4e-3, 8e-3)
    y_rad: tuple[float, ...] = (-8e-3, -4e-3, 0.0, 4e-3, 8e-3)
    radius_rad: float = 8.5e-3
    move_s: float = 0.1
    settle_s: float = 0.4
    hold_s: float = 0.2

    def __post_init__(self) -> None:
        self.require_positive("radius_rad", "move_s", "settle_s", "hold_s")
        for name in ("x_rad", "y_rad"):
            self.require(all(math.isfinite(a) for a in getattr(self, name)), name, "finite angles")

    @classmethod
    def offers(cls, bench: Bench, reach: Reach) -> Iterator[Self]:
        """Yield a coarse grid over most of the travel, on a bench that has the instrument and both axes."""
        if not channels_of(bench, (), ("theodolite_",)) or not {"theta_x", "theta_y"} <= set(bench.axes):
            return
        limit = bench.limits.reference[[bench.axes.index("theta_x"), bench.axes.index("theta_y")]]
        if np.all(np.isfinite(limit)):
            x, y = (rounded(0.7 * each) for each in limit.tolist())
            yield cls(x_rad=(-x, 0.0, x), y_rad=(-y, 0.0, y), radius_rad=float(np.max(limit)))

    def channels(self, bench: Bench) -> tuple[str, ...]:
        """Return the readings, and the instrument where the bench has one."""
        return channels_of(bench, ("output",), ("theodolite_",))

    def points(self) -> list[tuple[float, float]]:
        """Return the grid in the order in which it is visited, as (theta_x, theta_y) in rad."""
        return [(x, y) for x in self.x_rad for y in self.y_rad if math.hypot(x, y) <= self.radius_rad]

    def segments(self, bench: Bench) -> Iterator[Segment]:
        """Yield for every point a segment that goes there and one that holds; raises ConfigError without the axes."""
        # brings all effects: only a plan that is counted needs them
        from campaigns.strategies.design import feedback_of

        rate, record = rate_of(bench), self.channels(bench)
        x, y = axis_of(bench, "theta_x"), axis_of(bench, "theta_y")
        feedback = tuple(feedback_of(dof, rate) for dof in bench.axes)
        gates = tuple(Gate(0, axis, True) for axis in range(len(bench.axes)))
        move, settle = (samples_of_wave(t, rate) for t in (self.move_s, self.settle_s))
        hold = samples_of(self.hold_s, rate)
        at = np.zeros(len(bench.axes))
        for i, (x_rad, y_rad) in enumerate(self.points()):
            there = np.zeros(len(bench.axes))
            there[[x, y]] = x_rad, y_rad
            way = np.vstack([smooth_ramp(at, there, move), np.tile(there, (settle, 1))])
            for phase, reference, n in (("move", way, move + settle), ("hold", there[None, :], hold)):
                yield Segment(
                    label=f"{phase} {i + 1}",
                    n_samples=n,
                    reference=reference,
                    feedforward=np.zeros_like(reference),
                    feedback=feedback,
                    gates=gates,
                    record=record,
                    settings={"phase": phase, "theta_x_rad": x_rad, "theta_y_rad": y_rad},
                )
            at = there
