"""What each piece of knowledge gains: one fast chop with every designed strategy, each knowing more than the last."""

from __future__ import annotations

import csv
import io
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.recorded.settle import SettleTest, settle_of
from campaigns.log import read_run
from campaigns.plans import make_plan
from campaigns.playing.runner import run_plan
from campaigns.progress import Report, unheard
from sim_backend.axis_names import axis_text
from sim_backend.bench import Bench

ALPHA_DEG = {"theta_x": 0.0, "theta_y": 90.0}
"""Direction of a chop that moves this axis alone."""

STAGES = {
    "designed-linear": "modes of the mechanism",
    "designed-modes": "modes of the mechanism and the cryostat",
    "designed-hysteresis": "all modes and magnetic hysteresis",
    "designed": "all modes and magnetic hysteresis, and learns",
}
"""What each strategy knows, in the order in which knowledge is added."""


STAGE_HEADS = ("axis", "knows", "settling, ms", "overshoot, µrad", "stability 3σ, µrad", "peak current, A")


@dataclass(frozen=True)
class StageResult:
    """One strategy on one axis.

    Slowest settling (s, infinite: never), largest overshoot (rad), stability (rad, 3σ) and peak current (A; NaN where
    none was recorded).
    """

    axis: str
    strategy: str
    settling_s: float
    overshoot_rad: float
    stability_rad: float
    peak_a: float
    run_uid: str


def stage_of_test(axis: str, strategy: str, test: SettleTest, run_uid: str) -> StageResult:
    """Return a recorded fast chop as one row."""
    moved = test.moved[axis]
    return StageResult(
        axis,
        strategy,
        float(np.max(moved.time_s)),
        float(np.max(moved.overshoot)),
        test.stability.stability_rad,
        float("nan") if test.power is None else test.power.peak_a,
        run_uid,
    )


def play_stages(
    open_bench: Callable[[], Bench],
    controller: Path,
    axes: Sequence[str],
    *,
    seed: int,
    cycles: int = 25,
    report: Report = unheard,
) -> list[StageResult]:
    """Return the rows of every axis and strategy, each played on a new bench; raises what a run raises."""
    rows: list[StageResult] = []
    with tempfile.TemporaryDirectory(prefix="mccd-stages-") as folder:
        for axis in axes:
            for strategy in STAGES:
                report(len(rows), len(axes) * len(STAGES), f"playing {strategy} in {axis}")
                settings = {"alpha_deg": ALPHA_DEG[axis], "strategy": strategy, "controller": str(controller)}
                plan = make_plan("settling", {**settings, "cycles": cycles})
                bench = open_bench()
                try:
                    outcome = run_plan(plan, bench, Path(folder) / f"{axis}-{strategy}.h5", seed=seed)
                finally:
                    bench.close()
                with read_run(outcome.path) as run:
                    rows.append(stage_of_test(axis, strategy, settle_of(run), run.run_uid))
    return rows


def stages_csv(stages: Sequence[StageResult]) -> str:
    """Return the table of stages as CSV, in SI."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["axis", "strategy", "knows", "settling_s", "overshoot_rad", "stability_rad_3sigma", "peak_a"])
    for s in stages:
        row = (s.settling_s, s.overshoot_rad, s.stability_rad, s.peak_a)
        writer.writerow([s.axis, s.strategy, STAGES[s.strategy], *(f"{v:.6g}" for v in row)])
    return out.getvalue()


def stage_rows(stages: Sequence[StageResult]) -> list[tuple[str, ...]]:
    """Return the table of stages as people read it: ms, µrad, A."""
    return [
        (
            axis_text(s.axis),
            STAGES[s.strategy],
            f"{1e3 * s.settling_s:.1f}" if s.settling_s < float("inf") else "never",
            f"{1e6 * s.overshoot_rad:.2f}",
            f"{1e6 * s.stability_rad:.2f}",
            f"{s.peak_a:.2f}",
        )
        for s in stages
    ]
