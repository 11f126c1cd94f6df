"""Chopping between two positions along a direction: positional stability, repeatability and accuracy (6.4.1)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from campaigns.plans.base import Plan, channels_of, longest_segment, rate_of
from campaigns.sizes import samples_of, wave_samples
from campaigns.strategies import check_strategy, promise_of, stages_of
from campaigns.strategies.stages import Task, Tuning, learns, stage_segments
from campaigns.strategies.watch import CYCLES_AT_ONCE, Watch
from sim_backend.bench import SIMULATED, Bench, Segment
from sim_backend.errors import ConfigError
from sim_backend.model import bundled_models

if TYPE_CHECKING:
    from campaigns.strategies.design import Design

TIP_TILT = ("theta_x", "theta_y")


class ChopPlan(Plan, frozen=True, kw_only=True):
    """Chop from `from_rad` to `to_rad` about the axis at `alpha_deg` (0 is θx, 90 is θy), with `strategy`.

    `cycles` whole periods of 1/`frequency_hz`; the last `window_s` of each dwell are the observation. The strategy is
    designed on `model`, a design model by name or path; the designed strategies play the file `controller`.
    """

    name: ClassVar[str] = "chop"
    title: ClassVar[str] = "chop between two positions"
    by_cycle: ClassVar[bool] = True

    alpha_deg: float = 0.0
    from_rad: float = 0.0
    to_rad: float = 8.5e-3
    frequency_hz: float = 0.5
    cycles: int = 15
    window_s: float = 0.5
    strategy: str = "hybrid"
    model: str = "design-4th-order"
    tuning: Tuning = Tuning()
    controller: str | None = None

    def __post_init__(self) -> None:
        self.require_positive("frequency_hz", "cycles", "window_s")
        for name in ("alpha_deg", "from_rad", "to_rad"):
            self.require(math.isfinite(getattr(self, name)), name, "a finite number")
        self.require(self.from_rad != self.to_rad, "to_rad", f"another position than from_rad, {self.from_rad:g}")
        self.require(
            self.window_s <= 0.5 / self.frequency_hz, "window_s", f"at most a dwell, {0.5 / self.frequency_hz:g} s"
        )
        check_strategy(self.strategy, self.controller)

    def design_models(self) -> tuple[str, ...]:
        """Return the design model."""
        return (self.model,)

    def configuration(self) -> dict[str, Any]:
        """Return what decides the segments, the text of the controller included."""
        whole = super().configuration()
        if self.controller is None:
            return whole
        from campaigns.strategies.controller import dump_controller, load_controller  # few plans play one

        return {**whole, "controller": dump_controller(load_controller(self.controller))}

    def channels(self, bench: Bench) -> tuple[str, ...]:
        """Return commands and readings."""
        return channels_of(bench, ("input", "output"))

    def segments(self, bench: Bench) -> Iterator[Segment]:
        """Yield the strategy's stages in whole periods; raises ConfigError for an axis or model that does not fit."""
        rate = rate_of(bench)
        task = self._task(bench, rate)
        settings: dict[str, float | str] = {
            "alpha_deg": self.alpha_deg,
            "from_rad": self.from_rad,
            "to_rad": self.to_rad,
            "window_samples": samples_of(self.window_s, rate),
            "strategy": self.strategy,
        }
        record, longest = self.channels(bench), min(longest_segment(rate), CYCLES_AT_ONCE * task.period)
        chopping = self.cycles * task.period
        self.require_run(bench, chopping, chopping / max(longest, task.period))
        design = self._design(rate)
        if design.controller is None:
            self._require_own_model(bench)
        else:
            design.controller.require_bench(bench)
        for stage in stages_of(self.strategy, task, design):
            n_samples = chopping if stage.n_samples is None else stage.n_samples
            most = task.period if learns(stage.learning) else longest
            # what learning has left is judged by its first cycle
            first = task.period if stage.n_samples is None else most
            yield from stage_segments(task, stage, n_samples, most, record, settings, first)

    def watch(self, bench: Bench) -> Watch:
        """Return what judges every cycle."""
        rate = rate_of(bench)
        return Watch(promise_of(self.strategy, self._task(bench, rate), self._design(rate)), bench)

    def _require_own_model(self, bench: Bench) -> None:
        """Raise ConfigError for a real bench that is another than the bundled model has the feedback for."""
        who, bundled = bench.identity, bundled_models()
        if who.kind in SIMULATED or who.name in bundled or self.model not in bundled:
            return
        raise ConfigError(
            f"plan {self.name}: strategy '{self.strategy}' has a feedback tuned for the mirror of the bundled model "
            f"'{self.model}', and this bench is '{who.name}': give the file of its own model (--model), or design a "
            "controller from its logs (`mccd design`)"
        )

    def _design(self, rate_hz: float) -> Design:
        from campaigns.strategies.design import Design  # brings all effects: only a plan that is counted needs them

        if self.controller is None:
            return Design.load(self.model, rate_hz)
        return Design.controlled(self.controller, rate_hz)

    def _task(self, bench: Bench, rate_hz: float) -> Task:
        dwell = 0.5 * rate_hz / self.frequency_hz
        wave_samples(2.0 * dwell, rate_hz)
        self.require(
            abs(dwell - round(dwell)) < 1e-6 and dwell >= 2,
            "frequency_hz",
            f"such that a dwell is whole samples at {rate_hz:g} Hz, as with {0.5 * rate_hz / max(round(dwell), 2):.6g}",
        )
        alpha = math.radians(self.alpha_deg)
        # rounding of cos 90° would else move the other axis by 1e-19 rad
        direction = np.round([math.cos(alpha), math.sin(alpha)], 12)
        along = np.zeros(len(bench.axes))
        for dof, part in zip(TIP_TILT, direction, strict=True):
            if dof in bench.axes:
                along[bench.axes.index(dof)] = part
            elif part:
                raise ConfigError(
                    f"plan {self.name}: alpha_deg {self.alpha_deg:g} moves {dof}, which the bench lacks; "
                    f"its axes are {', '.join(bench.axes)}"
                )
        return Task(bench.axes, self.from_rad * along, self.to_rad * along, round(dwell), self.tuning)
