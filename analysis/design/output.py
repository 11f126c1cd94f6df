"""What a design writes: the controller, its numbers, its figures, and a page that shows them."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from analysis.design.api import AxisDesign, Designed
from analysis.design.feedback import PEAK_DB, WORST_PEAK_DB
from analysis.design.figures import design_figures
from analysis.design.stages import STAGE_HEADS, StageResult, stage_rows, stages_csv
from analysis.measurements.settling import BAND_RAD
from analysis.pages.environment import page_environment
from analysis.pages.svg import inlined
from analysis.recorded.requirements import POWER_W, SETTLING_S, STABILITY_RAD
from campaigns.spreadsheet import inert_frame
from campaigns.strategies.controller import FILE_NAME, dump_controller
from campaigns.version import tool_commit, tool_version
from sim_backend.axis_names import axis_text
from sim_backend.errors import ConfigError
from sim_backend.safe_write import folder_within, write_text


def prepare_folder(folder: Path) -> Path:
    """Make the folder; raises ConfigError when it holds a controller already or cannot be one."""
    if (folder / FILE_NAME).exists():
        raise ConfigError(f"{folder / FILE_NAME} exists and would be overwritten; choose another --out")
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"{folder} is a file; choose a folder for --out")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def write_controller(designed: Designed, folder: Path) -> Path:
    """Write the controller file and return its path."""
    return write_text(folder / FILE_NAME, dump_controller(designed.controller))


def numbers_of(one: AxisDesign) -> dict[str, Any]:
    """Return everything that speaks for one axis, SI units in the names; bands hold identified plant and worst one."""
    feedback, learning, noise, move = one.feedback, one.learning, one.noise, one.price.move
    margins = feedback.margins
    return {
        "stability_3sigma_rad": {
            "identified": float(feedback.three_sigma_rad[0]),
            "worst": float(feedback.three_sigma_rad.max()),
            "from_torque": feedback.from_torque_rad,
            "from_reading": feedback.from_reading_rad,
            "bound_of_any_linear_feedback": feedback.least_rad,
            "limit": STABILITY_RAD,
        },
        "settling_s": {"reference_arrives": move.arrival_s, "limit": SETTLING_S},
        "move": {
            "samples": move.n_samples,
            "concentration": move.concentration,
            "peak_torque_nm": move.peak_nm,
            "peak_current_a": one.price.peak_a,
            "power_w": one.price.power_w,
            "beyond_the_learned_band_rad": move.unlearned_rad,
        },
        "price": {name: [getattr(point, name) for point in one.curve] for name in ("allowed_s", "power_w", "peak_a")}
        | {"arrival_s": [point.move.arrival_s for point in one.curve]},
        "margins": {
            "gain_db": margins.gain_margin_db,
            "phase_deg": margins.phase_margin_deg,
            "crossover_hz": margins.crossover_hz,
            "sensitivity_peak_db": {"identified": float(feedback.peak_db[0]), "worst": float(feedback.peak_db.max())},
        },
        "feedback": {"effort_rad_nm": feedback.effort_rad_nm, "distrust": feedback.distrust},
        "learning": {
            "cutoff_hz": learning.cutoff_hz,
            "lead_samples": learning.lead_samples,
            "periods": len(learning.gains),
            "largest_factor_per_period": one.learning.largest,
            "from_measured_lines": 0 if learning.lines_hz is None else int(learning.lines_hz.size),
        },
        "noise": {
            "torque_nm": noise.noise.torque_nm,
            "bandwidth_hz": noise.noise.bandwidth_hz,
            "reading_rad": noise.noise.reading_rad,
            "relative_std": noise.relative_std.tolist(),
        },
    }


def document(designed: Designed, stages: Sequence[StageResult] = ()) -> dict[str, Any]:
    """Return the content of `design.json`."""
    return {
        "schema": "mccd-design/1",
        "mccd": f"{tool_version()} ({tool_commit()})",
        "controller": FILE_NAME,
        "model": designed.controller.model.name,
        "runs": list(designed.sources),
        "axes": {one.dof: numbers_of(one) for one in designed.axes},
        "stages": [{f: getattr(row, f) for f in row.__dataclass_fields__} for row in stages],
    }


def write_numbers(designed: Designed, folder: Path, stages: Sequence[StageResult] = ()) -> Path:
    """Write `design.json` and return its path."""
    text = json.dumps(_finite(document(designed, stages)), indent=2, allow_nan=False, ensure_ascii=False)
    return write_text(folder / "design.json", text + "\n")


def write_design(designed: Designed, folder: Path, stages: Sequence[StageResult] = ()) -> dict[str, Path]:
    """Write `design.json`, `stages.csv` when there are stages, figures and `index.html`; return paths by name."""
    figures = folder_within(folder, "figures")
    stamp = f"mccd {tool_version()} ({tool_commit()}) · runs {', '.join(uid[:8] for uid in designed.sources)}"
    paths: dict[str, Path] = {}
    drawings = {}
    for name, canvas in design_figures(designed).items():
        svg = canvas.svg(stamp)
        paths[f"figures/{name}.svg"] = write_text(figures / f"{name}.svg", svg)
        write_text(figures / f"{name}.csv", inert_frame(canvas.numbers()).to_csv(index=False))
        drawings[name] = (canvas.title, canvas.caption, Markup(inlined(svg, name, canvas.title)))
    content = document(designed, stages)
    paths["design.json"] = write_numbers(designed, folder, stages)
    if stages:
        paths["stages.csv"] = write_text(folder / "stages.csv", stages_csv(stages))
    return paths | {"index.html": write_text(folder / "index.html", _page(designed, content, stages, drawings))}


def axis_rows(designed: Designed) -> list[tuple[str, ...]]:
    """Return what is expected of every axis, with its limits, as people read it."""
    rows: list[tuple[str, ...]] = []
    for one in designed.axes:
        f, name = one.feedback, axis_text(one.dof)
        worst = 1e6 * f.three_sigma_rad.max()
        rows += [
            (name, "stability 3σ, µrad", f"{1e6 * f.three_sigma_rad[0]:.3f}, worst plant {worst:.3f}", "1.7"),
            ("", "bound of any linear feedback, µrad", f"{1e6 * f.least_rad:.3f}", ""),
            ("", "reference arrives after, ms", f"{1e3 * one.price.move.arrival_s:.1f}", f"{1e3 * SETTLING_S:g}"),
            ("", "peak current, A", f"{one.price.peak_a:.2f}", f"{designed.limit_a:g}"),
            ("", "power of a 5 Hz chop, W", _power_told(one.price.power_w), f"{POWER_W:g}"),
            (
                "",
                "peak of |S|, dB",
                f"{f.peak_db[0]:.2f}, worst plant {f.peak_db.max():.2f}",
                f"{PEAK_DB:g}, {WORST_PEAK_DB:g}",
            ),
            (
                "",
                "gain margin, dB; phase margin, °",
                f"{f.margins.gain_margin_db:.1f}; {f.margins.phase_margin_deg:.0f}",
                "",
            ),
            (
                "",
                "left by learning, 95 % of plants, µrad",
                f"{1e6 * one.learning.expected.left_rad:.3f}",
                f"{1e6 * BAND_RAD:g}",
            ),
        ]
    return rows


def _power_told(power_w: float) -> str:
    return "not stated by the bench" if math.isnan(power_w) else f"{power_w:.3f}"


AXIS_HEADS = ("axis", "expected", "value", "limit")


def _page(
    designed: Designed,
    content: dict[str, Any],
    stages: Sequence[StageResult],
    drawings: dict[str, tuple[str, str, Markup]],
) -> str:
    return str(
        page_environment("analysis.design")
        .get_template("design.html.j2")
        .render(
            name=designed.controller.name,
            axes=(AXIS_HEADS, axis_rows(designed)),
            stages=(STAGE_HEADS, stage_rows(stages)) if stages else None,
            drawings=drawings,
            runs=designed.sources,
            version=content["mccd"],
        )
    )


def _finite(node: Any) -> Any:
    """Replace what JSON cannot hold (a strategy that never settles, a current that was not recorded) by null."""
    if isinstance(node, dict):
        return {k: _finite(v) for k, v in node.items()}
    if isinstance(node, list):
        return [_finite(v) for v in node]
    return None if isinstance(node, float) and not abs(node) < float("inf") else node
