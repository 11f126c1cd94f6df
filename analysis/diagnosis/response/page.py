"""The page of a diagnosis of frequency responses: the Bode picture of data and both models, then the rest."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from analysis.diagnosis.answer.figures import (
    AFTER,
    BEFORE,
    DOTS,
    NOISE,
    WIDE,
    Drawn,
    evidence_figures,
    file_names,
    finer_ticks,
)
from analysis.diagnosis.answer.page import Figures, write_drawn
from analysis.diagnosis.records.loading import Source
from analysis.diagnosis.response.diagnose import Responses, by_frequency
from analysis.diagnosis.result import Diagnosis
from analysis.pages.bode import PHASES_DEG, bode_canvas, draw_response, per, scale_axes
from analysis.pages.canvas import Canvas
from sim_backend.model import Model

SIZE = (WIDE, 4.8)
"""Three panels high."""


def write_response_page(
    diagnosis: Diagnosis, drawn: Responses, model: Model, sources: Sequence[Source], out: Path
) -> dict[str, Path]:
    """Write `index.html` and its figures (SVG and CSV) into the folder `out` and return the paths by name."""
    record = next((curve.record for curve in diagnosis.evidence["frequency"]), "")
    after = {"frequency": by_frequency(drawn.lines, drawn.noise, drawn.extended, model, record)}
    first, *others = bode_figures(drawn, model)
    shown = evidence_figures(diagnosis.evidence, after, model)
    figures = Figures(opening=(first,), response=tuple(others), evidence=tuple(shown))
    return write_drawn(diagnosis, model, sources, out, figures)


def bode_figures(drawn: Responses, model: Model) -> list[Drawn]:
    """Return one figure per entry: magnitude, phase, and what either model leaves over the response, with the noise."""
    lines = drawn.lines
    places = sorted(set(zip(lines.output.tolist(), lines.input.tolist(), strict=True)))
    pairs = [(model.inputs[i], model.outputs[o]) for o, i in places]
    names = file_names([f"{one.dof}-{other.dof}" for one, other in pairs])
    figures = []
    for (o, i), (source, target), name in zip(places, pairs, names, strict=True):
        rows = np.flatnonzero((lines.output == o) & (lines.input == i))
        title = f"{source.dof} → {target.dof}"
        canvas = bode_canvas(f"Response {title}", title, per(target.unit, source.unit), SIZE, rows=3)
        canvas.panel(2, "", "frequency (Hz)", "error ÷ response")
        _draw(canvas, drawn, rows)
        caption = (
            f"The measured response {title}, the given model with its own numbers adjusted, and the extended model. "
            "Below: what each leaves over the size of the response, and the standard deviation of the noise (grey)."
        )
        levels = np.unique(lines.level[rows])
        if levels.size > 1:
            told = ", ".join(f"{level:g}" for level in levels[:8])
            caption += f" Levels of excitation: {told}{f' {lines.level_unit}' if lines.level_unit else ''}."
        figures.append(Drawn(f"response-{name}", f"Response {title}", caption, canvas))
    return figures


def _draw(canvas: Canvas, drawn: Responses, rows: np.ndarray) -> None:
    lines = drawn.lines
    measured, size = lines.response[rows], np.abs(lines.response[rows])
    canvas.points(0, "measured", lines.frequency_hz[rows], size, **DOTS)
    canvas.points(1, "measured", lines.frequency_hz[rows], np.degrees(np.angle(measured)), **DOTS)
    sigma = np.sqrt(np.mean(drawn.noise.sigma[rows] ** 2, axis=1)) / size
    canvas.points(2, "noise floor", lines.frequency_hz[rows], sigma, color=NOISE, marker="_", markersize=3.0)
    for label, modelled, colour in (("adjusted", drawn.nominal, BEFORE), ("extended", drawn.extended, AFTER)):
        # a model has one response: that at the points of all levels together
        f, first = np.unique(lines.frequency_hz[rows], return_index=True)
        draw_response(canvas, label, f, modelled[rows][first], color=colour, linewidth=1.0)
        off = np.abs(modelled[rows] - measured) / size
        canvas.points(2, label, lines.frequency_hz[rows], off, color=colour, markersize=2.0)
    scale_axes(canvas)
    canvas.axes[2].set_yscale("log")
    for axes in canvas.axes:
        finer_ticks(axes)
    canvas.axes[1].set_yticks(PHASES_DEG)
    canvas.legend_outside()
