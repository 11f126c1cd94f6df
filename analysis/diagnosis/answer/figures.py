"""The figures of a diagnosis: residual before and after in time, and in every domain against the noise."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.records.dataset import Dataset
from analysis.diagnosis.result import Domain
from analysis.pages.canvas import COLOURS, QUIET, Canvas, thinned
from analysis.pages.quantities import chance, scaled
from sim_backend.model import Model

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

BEFORE, AFTER = COLOURS[0], COLOURS[1]
"""As in the interactive plots, whose colours follow the order."""

MOST_POINTS = 1500
"""Longest curve of a figure: each stretch of a longer one is drawn with its least and its greatest value."""

SIZE = (4.4, 2.7)
"""Small enough to be read on a telephone, two beside each other on a desk."""

STEEP = 20.0

QUANTITIES = {
    "frequency": "frequency",
    "amplitude": "amplitude of the motion (moving rms)",
    "position": "position",
    "direction": "direction of motion",
    "rate": "rate",
    "time": "time",
    "temperature": "temperature",
    "cross-axis": "other axis",
    "level": "level of excitation",
}


@dataclass(frozen=True)
class Drawn:
    """One finished figure: its name in files, what it shows, and its canvas."""

    name: str
    title: str
    caption: str
    canvas: Canvas


def residual_figures(
    data: Dataset, before: Sequence[Array], after: Sequence[Array], noise_rms: Array, model: Model
) -> list[Drawn]:
    """Return, per output, the residual in time of the segment where it was largest, before and after."""
    drawn = []
    names = file_names([port.dof for port in model.outputs])
    for o, port in enumerate(model.outputs):
        i, w = max(
            data.windows,
            key=lambda place: float(np.mean(before[place[0]][place[1].start : place[1].stop, o] ** 2)),
        )
        old, new = (x[i][w.start : w.stop, o] for x in (before, after))
        factor, unit = scaled(float(np.max(np.abs(old))), port.unit)
        canvas = Canvas(f"Residual of {port.dof}", "", size=SIZE)
        canvas.panel(0, port.dof, "time in the segment (s)", f"measured − simulated ({unit})")
        time_s = np.arange(w.stop - w.start) / data.rate_hz
        canvas.line(0, "nominal", *thinned(time_s, old * factor, MOST_POINTS), color=BEFORE, linewidth=0.9)
        canvas.line(0, "extended", *thinned(time_s, new * factor, MOST_POINTS), color=AFTER, linewidth=0.9)
        reach = 2.0 * float(noise_rms[o]) * factor
        canvas.band(0, -reach, reach, "noise, ±2σ")
        canvas.legend_above(0)
        held = ", which no fit has seen" if w.held_out else ""
        step = -(-2 * time_s.size // MOST_POINTS) if time_s.size > MOST_POINTS else 1
        drawn_of = f" Of every {step} samples the least and the greatest are drawn." if step > 1 else ""
        caption = f"{port.dof} in segment “{w.label}”{held}: where the nominal model misses most.{drawn_of}"
        drawn.append(Drawn(f"residual-{names[o]}", f"Residual of {port.dof}", caption, canvas))
    return drawn


def file_names(names: Sequence[str]) -> list[str]:
    """Return names for files and for elements of a page: letters, digits, `_` and `-` alone, each different."""
    plain = [re.sub(r"[^A-Za-z0-9_-]+", "_", name)[:64] for name in names]
    return plain if len(set(plain)) == len(plain) else [f"{i}-{name}" for i, name in enumerate(plain, start=1)]


def evidence_figures(
    before: dict[str, tuple[Domain, ...]], after: dict[str, tuple[Domain, ...]], model: Model
) -> list[Drawn]:
    """Return one figure per domain: the run and output with the strongest evidence, before and after."""
    drawn = []
    for name, curves in before.items():
        if not curves:
            continue
        # p-values run into zero; then the higher peak decides
        worst = min(curves, key=lambda d: (d.p_value, -float(np.max(d.level))))
        same = [d for d in after.get(name, ()) if (d.record, d.output) == (worst.record, worst.output)]
        canvas = _drawn(name, worst, same[0] if same else None, model)
        drawn.append(Drawn(f"evidence-{name}", f"By {name}", f"{worst.where} ({chance(worst.p_value)}).", canvas))
    return drawn


def by_category(name: str) -> bool:
    """Tell whether a domain has names along its axis instead of a quantity."""
    return name in ("direction", "cross-axis")


def categories(name: str, domain: Domain, model: Model) -> tuple[str, ...]:
    """Return the names along the axis of a domain by category."""
    return ("down", "up") if name == "direction" else tuple(model.outputs[int(k)].dof for k in domain.axis)


def level_label(name: str) -> str:
    """Return what the levels of a domain are."""
    return "share that follows ÷ noise" if name == "cross-axis" else "residual ÷ noise"


def is_steep(domain: Domain) -> bool:
    """Tell whether a curve rises so far above the noise that only a logarithmic axis shows both."""
    return float(np.max(domain.level)) > STEEP * float(np.mean(domain.floor))


def _drawn(name: str, first: Domain, second: Domain | None, model: Model) -> Canvas:
    factor, unit = (1.0, "") if by_category(name) else scaled(float(np.max(np.abs(first.axis))), first.unit)
    canvas = Canvas(name, "", size=SIZE)
    canvas.panel(0, f"{first.output}", f"{QUANTITIES[name]}{f' ({unit})' if unit else ''}", level_label(name))
    if by_category(name):
        _as_bars(canvas, first, second, categories(name, first, model))
    else:
        _as_curves(canvas, first, second, factor)
        if name == "frequency":
            canvas.axes[0].set_xscale("log")
    _floor(canvas, first)
    canvas.legend_above(0)
    return canvas


def _as_curves(canvas: Canvas, first: Domain, second: Domain | None, factor: float) -> None:
    for label, curve, colour, mark in (("nominal", first, BEFORE, "o"), ("extended", second, AFTER, "s")):
        if curve is not None:
            canvas.line(0, label, curve.axis * factor, curve.level, color=colour, marker=mark, markersize=2.2)


def _as_bars(canvas: Canvas, first: Domain, second: Domain | None, names: Sequence[str]) -> None:
    at = np.arange(first.axis.size, dtype=float)
    for label, curve, colour, shift in (("nominal", first, BEFORE, -0.2), ("extended", second, AFTER, 0.2)):
        if curve is not None:
            canvas.bars(0, label, at + shift, curve.level, 0.38, color=colour)
    canvas.axes[0].set_xticks(at, names, parse_math=False)
    canvas.axes[0].grid(axis="x", visible=False)


def _floor(canvas: Canvas, first: Domain) -> None:
    axes: Axes = canvas.axes[0]
    level = float(np.mean(first.floor))
    top = max(float(np.max(first.level)), level)
    if is_steep(first):
        axes.set_yscale("log")
        from matplotlib.ticker import FuncFormatter  # see `analysis.pages.canvas`

        axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
        axes.set_ylim(bottom=0.4 * level)
    else:
        axes.set_ylim(0.0, 1.15 * max(top, 1.3 * level))
    axes.axhline(level, color=QUIET, linewidth=1.0, linestyle=(0, (4, 3)), label="noise")
