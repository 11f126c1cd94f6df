"""Fig. 6.10: sensitivity and complementary sensitivity of the θx loop."""

from __future__ import annotations

import numpy as np

from analysis.pages.canvas import COLOURS, OURS, PAPER, Canvas
from analysis.paper.loop_shape import open_loop
from analysis.paper.measured import Measured
from analysis.paper.numbers import paper_tables
from sim_backend.control.feedback import complementary_sensitivity, sensitivity


def figure_6_10(measured: Measured) -> Canvas:
    """Return magnitude and phase of T and S on the design model, and on the identified one where there is a sweep."""
    canvas = Canvas(
        "Sensitivity and complementary sensitivity of the θx loop",
        "Design model without the hold's delay, as the paper computed it; thin: the model identified on the bench, "
        "with the hold. The cross marks the paper's peak, 4 dB at 500 Hz.",
        rows=2,
        size=(7.2, 5.2),
        share_x=True,
    )
    # the paper's axis: 1 to 1e4 rad/s
    f = np.geomspace(1.0, 1e4, 1200) / (2.0 * np.pi)
    canvas.panel(0, "", "", "magnitude (dB)")
    canvas.panel(1, "", "frequency (Hz)", "phase (°)")
    _curves(canvas, f, open_loop(measured.design_axis("theta_x"), f), "design", 1.4)
    fit = measured.fit("theta_x")
    if fit is not None:
        _curves(canvas, f, open_loop(fit.model, f, 1e4), "identified", 0.7)
    text = paper_tables()["text"]
    canvas.points(
        0,
        "paper's peak of S",
        [text.value("sensitivity frequency")],
        [text.value("sensitivity peak")],
        color=PAPER,
        marker="x",
        markersize=7,
    )
    for axes in canvas.axes:
        axes.set_xscale("log")
    canvas.axes[0].set_ylim(-70, 12)
    canvas.second_scale(0, "frequency (rad/s), as in the paper", 2.0 * np.pi)
    canvas.legend(0, loc="lower right", ncols=2)
    return canvas


def _curves(canvas: Canvas, f: np.ndarray, loop: np.ndarray, name: str, width: float) -> None:
    for letter, colour, response in (
        ("T", OURS, complementary_sensitivity(loop)),
        ("S", COLOURS[2], sensitivity(loop)),
    ):
        style = {"color": colour, "linewidth": width}
        canvas.line(0, f"{letter}, {name}", f, 20.0 * np.log10(np.abs(response)), **style)
        canvas.line(1, f"{letter}, {name}", f, np.rad2deg(np.unwrap(np.angle(response))), **style)
