"""The page of an identification: its modes and numbers, its remarks, and the Bode diagram of data and model."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup, escape

from analysis.identification.bode import measured_curves
from analysis.identification.identified import Identification
from analysis.identification.modelled_response import frequencies_of, response_of
from analysis.identification.response_curves import ResponseCurve
from analysis.identification.summary import HEADS, facts, modes_table
from analysis.pages.bode import PHASES_DEG, bode_canvas, draw_response, per, scale_axes
from analysis.pages.canvas import COLOURS, INK, QUIET, Canvas
from analysis.pages.environment import page_environment
from analysis.pages.svg import inlined
from campaigns.log import Run
from campaigns.version import tool_commit, tool_version
from sim_backend.axis_names import with_axes
from sim_backend.safe_write import require_new_or_own, write_text

GENERATOR = b'<meta name="generator" content="mccd identify">'
"""The line of the template by which such a page is recognised."""

SIZE = (5.0, 4.6)


def require_page(path: Path) -> None:
    """Raise ConfigError where a page would replace anything but an earlier page of an identification.

    Raises OSError where its folder is not writable.
    """
    require_new_or_own(path, lambda begin: GENERATOR in begin, "page of `mccd identify`")


def write_page(found: Identification, runs: Sequence[Run], sources: Sequence[Path], path: Path) -> Path:
    """Write the page, replacing one of that name, and return its path; raises as `require_page`."""
    require_page(path)
    figures = bode_figures(found, measured_curves(found, runs))
    drawings = [
        (canvas, Markup(inlined(canvas.svg(), f"c{i}", str(escape(canvas.title))))) for i, canvas in enumerate(figures)
    ]
    page = page_environment("analysis.identification").get_template("identification.html.j2")
    text = page.render(
        found=found,
        heads=HEADS,
        modes=modes_table(found),
        facts=facts(found),
        sources=[str(source) for source in sources],
        drawings=drawings,
        version=f"{tool_version()} ({tool_commit()})",
    )
    return write_text(path, str(text))


def bode_figures(found: Identification, curves: Sequence[ResponseCurve]) -> list[Canvas]:
    """Return one figure per entry: magnitude and phase, dots measured and line modelled, grey the deviation."""
    model = found.model
    f = frequencies_of(model, curves)
    modelled = response_of(model, f, continuous=found.of_a_table)
    figures = []
    for k, output in enumerate(model.outputs):
        for j, input_ in enumerate(model.inputs):
            own = [curve for curve in curves if (curve.output, curve.input) == (output.name, input_.name)]
            if not own and not np.any(modelled[:, k, j]):
                continue
            title = with_axes(f"{input_.name} → {output.name}")
            canvas = bode_canvas(f"Response {title}", title, per(output.unit, input_.unit), SIZE)
            canvas.caption = "Dots: measured. Line: the model. Grey: standard deviation of the magnitude, where known."
            for curve in own:
                _draw_measured(canvas, curve)
            if np.any(modelled[:, k, j]):
                draw_response(canvas, "model", f, modelled[:, k, j], color=COLOURS[1], linestyle="-", linewidth=1.2)
            scale_axes(canvas)
            canvas.axes[1].set_yticks(PHASES_DEG)
            canvas.legend_outside()
            figures.append(canvas)
    return figures


def _draw_measured(canvas: Canvas, curve: ResponseCurve) -> None:
    dots = {"color": INK, "marker": ".", "markersize": 2.5}
    canvas.points(0, "measured", curve.frequency_hz, curve.magnitude, **dots)
    canvas.points(1, "measured", curve.frequency_hz, np.degrees(curve.phase_rad), **dots)
    known = np.isfinite(curve.std) & (curve.std > 0.0)
    if np.any(known):
        f, std = curve.frequency_hz[known], curve.std[known]
        canvas.points(0, "deviation", f, std, color=QUIET, marker="_", markersize=2.5)
