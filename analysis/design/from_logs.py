"""A controller from the logs of a campaign alone: identify, add the magnetic hysteresis, design."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from analysis.design.api import Designed, Options, design_controller
from analysis.design.output import write_controller, write_numbers
from analysis.identification.identify import identify_runs
from analysis.recorded.chop import TIP_TILT
from campaigns.log import Run
from campaigns.strategies.controller import FILE_NAME
from sim_backend.bench import Limits
from sim_backend.model import dump_model
from sim_backend.safe_write import write_text


def design_from_logs(runs: Sequence[Run], limits: Limits, bench_axes: tuple[str, ...], out: Path) -> Path | None:
    """Return the controller file in `out`, designed from complete runs; one that is there already is kept.

    None when the runs lack a sweep of a tilt axis that the bench has, or the bench at rest. Raises what identification
    and design do.
    """
    if (out / FILE_NAME).exists():
        return out / FILE_NAME
    found = _sources(runs, [axis for axis in TIP_TILT if axis in bench_axes])
    if found is None:
        return None
    designed = _designed(*found, limits, bench_axes, out)
    write_numbers(designed, out)
    return write_controller(designed, out)


def _sources(runs: Sequence[Run], axes: Sequence[str]) -> tuple[list[Run], list[Run]] | None:
    """The sweeps to identify from, and the other records to design from; None when something is missing."""
    sweeps = [next((run for run in runs if _sweeps(run, axis)), None) for axis in axes]
    rest = [run for run in runs if run.header.test == "rest"]
    loops = [run for run in runs if run.header.test == "hysteresis"]
    found = [run for run in sweeps if run is not None]
    return (found, [*rest[:1], *loops]) if rest and found and len(found) == len(axes) else None


def _sweeps(run: Run, axis: str) -> bool:
    """Whether a run sweeps this axis at the temperature that the bench is used at."""
    test, settings = run.header.test, run.header.settings
    return test == "sinesweep" and is_source(test, settings) and settings.get("axis") == axis


def is_source(test: str, settings: Mapping[str, Any]) -> bool:
    """Tell whether a run of such a test may be among those that a controller is designed from."""
    return test in ("rest", "hysteresis") or (test == "sinesweep" and settings.get("cold_finger_k") is None)


def _designed(sweeps: list[Run], others: list[Run], limits: Limits, axes: tuple[str, ...], out: Path) -> Designed:
    model = identify_runs(sweeps, name="nominal").model
    out.mkdir(parents=True, exist_ok=True)
    write_text(out / "nominal.toml", dump_model(model))
    return design_controller(model, [*others, *sweeps], limits, axes, Options())
