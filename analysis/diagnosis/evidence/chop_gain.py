"""The gain in the user's own terms: settling and stability of a chop whose feed-forward knows what was found.

The same chop is played twice on the bench, with the feed-forward designed on the nominal and on the extended model. A
feed-forward is linear, so it profits from the adjusted modes and from effects on them (a shifted stiffness, a further
resonance), not from friction or hysteresis.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from campaigns.log import read_run
from campaigns.plans import make_plan
from campaigns.playing.runner import run_plan
from sim_backend.bench import Bench
from sim_backend.errors import MccdError
from sim_backend.model import Model

STRATEGY = "hybrid"

ALPHA_DEG = {"theta_x": 0.0, "theta_y": 90.0}
"""Direction of a chop that moves this axis alone."""


@dataclass(frozen=True)
class ChopGain:
    """One chopped axis before and after: slowest settling (s; infinite: never), stability (rad, 3 sigma, 2D)."""

    axis: str
    strategy: str
    settling_before_s: float
    settling_after_s: float
    stability_before_rad: float
    stability_after_rad: float


def chop_gains(
    open_bench: Callable[[], Bench],
    nominal: str,
    extended: str,
    model: Model,
    *,
    seed: int,
    size_rad: float = 8.5e-3,
    cycles: int = 10,
) -> tuple[ChopGain, ...]:
    """Return the gain of every tip or tilt axis that `model` drives; `nominal` and `extended` name the design models.

    `open_bench` gives a new bench for each chop, so that both start alike. Raises ConfigError where no feed-forward
    can be designed on a model or the bench cannot play the chop, HardwareError when the bench fails.
    """
    driven = {p.dof for p in model.inputs} & {p.dof for p in model.outputs}
    gains = []
    for axis in (a for a in ALPHA_DEG if a in driven):
        both = [_chopped(open_bench, design, axis, seed, size_rad, cycles) for design in (nominal, extended)]
        gains.append(ChopGain(axis, STRATEGY, both[0][0], both[1][0], both[0][1], both[1][1]))
    return tuple(gains)


def chops_or_why(
    open_bench: Callable[[], Bench], nominal: str | Path, extended: str | Path, model: Model, seed: int
) -> tuple[tuple[ChopGain, ...], tuple[str, ...]]:
    """Return the gain of every axis, or none and a remark that says why the bench could not play the chop."""
    try:
        return chop_gains(open_bench, str(nominal), str(extended), model, seed=seed), ()
    except MccdError as error:
        return (), (f"the chop that shows what the extended model gains could not be played: {error}",)


def _chopped(
    open_bench: Callable[[], Bench], design: str, axis: str, seed: int, size_rad: float, cycles: int
) -> tuple[float, float]:
    # it brings all strategies of control with it, seconds of start-up that few diagnoses need
    from analysis.recorded.settle import settle_of

    settings = {"strategy": STRATEGY, "alpha_deg": ALPHA_DEG[axis], "to_rad": size_rad, "cycles": cycles}
    plan = make_plan("settling", {**settings, "model": design})
    bench = open_bench()
    try:
        with tempfile.TemporaryDirectory(prefix="mccd-chop-") as folder:
            outcome = run_plan(plan, bench, Path(folder) / "chop.h5", seed=seed)
            with read_run(outcome.path) as run:
                test = settle_of(run)
    finally:
        bench.close()
    slowest = float(np.max(test.moved[axis].time_s))
    return slowest if np.isfinite(slowest) else float("inf"), test.stability.stability_rad
