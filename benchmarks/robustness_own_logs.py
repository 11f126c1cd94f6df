"""A bench that is identified, designed for and chopped from its own logs alone, as `mccd settle` does it."""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from analysis.design.from_logs import design_from_logs
from benchmarks.robustness_benches import AXES
from benchmarks.robustness_trial import judge_of, verdict
from campaigns.log import read_run
from campaigns.playing.campaign_run import run_campaign
from campaigns.playing.designed_campaign import measuring_campaign
from sim_backend.errors import MccdError
from sim_backend.model import Model, dump_model
from sim_backend.simbench import SimBench

OWN = "own logs"
"""The strategy: a controller from the bench's own logs."""


def identified_and_played(bench: Model, drawn: dict[str, float], index: int) -> dict[str, Any]:
    """Return what was drawn, the verdict on the bench's own controller, and how long each of its steps took in s.

    Where a step fails before anything is chopped, the verdict says which and why; nothing moved that could stray.
    """
    took: dict[str, float] = {}
    out: dict[str, Any] = {**drawn, "took_s": took}
    with TemporaryDirectory(prefix="own-logs-") as kept:
        folder, step = Path(kept), "measure"
        try:
            began = time.monotonic()
            logs = _measured(bench, folder, index)
            step, took["measure"] = "design", round(time.monotonic() - began, 1)
            began = time.monotonic()
            controller = _designed(bench, logs, folder / "design", index)
            took["design"] = round(time.monotonic() - began, 1)
        except MccdError as error:
            took[step] = round(time.monotonic() - began, 1)
            return {**out, OWN: {"error": f"{step} refused: {error}", "safe": step == "design"}}
        began = time.monotonic()
        judge = judge_of("designed", "designed", controller=str(controller))
        out[OWN] = verdict(judge, bench, 2 * index)
        took["play"] = round(time.monotonic() - began, 1)
    return out


def _measured(bench: Model, folder: Path, index: int) -> list[Path]:
    """Return the logs of the campaign that a design needs."""
    model = folder / "bench.toml"
    model.write_text(dump_model(bench), encoding="utf-8")
    played = run_campaign(measuring_campaign(list(AXES)), folder / "runs", address=f"sim:{model}", seed=index)
    return [run.log for run in played.runs]


def _designed(bench: Model, logs: list[Path], out: Path, index: int) -> Path:
    sim = SimBench(bench, index)
    with ExitStack() as stack:
        runs = [stack.enter_context(read_run(log)) for log in logs]
        controller = design_from_logs(runs, sim.limits, sim.axes, out)
    assert controller is not None, "the campaign has recorded all that a design needs"
    return controller
