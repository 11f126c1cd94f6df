"""Fig. 6.4: calibration of both angles against the theodolite."""

from __future__ import annotations

import numpy as np

from analysis.pages.canvas import OURS, PAPER, Canvas
from analysis.paper.measured import Measured
from analysis.paper.numbers import paper_tables


def figure_6_4(measured: Measured) -> Canvas | None:
    """Return both readings against each other, and their difference with the fitted and the paper's gain."""
    test = measured.theodolite()
    if test is None:
        return None
    canvas = Canvas(
        "Calibration against the theodolite",
        "Above: theodolite against sensors. Below: their difference, with the fitted gain and the paper's.",
        rows=2,
        columns=2,
        size=(7.2, 5.0),
    )
    for i, (axis, name) in enumerate((("theta_x", "θx"), ("theta_y", "θy"))):
        sensor, read = test.sensor_rad[:, i] * 1e3, test.theodolite_rad[:, i] * 1e3
        gain, offset = test.calibration.gain_correction[i], test.calibration.offset_rad[i]
        span = np.array([sensor.min(), sensor.max()])
        canvas.panel(i, f"{name}", "sensor angle (mrad)", "theodolite (mrad)")
        canvas.points(i, "held points", sensor, read, color=OURS)
        canvas.line(i, "gain one", span, span, color="#6b7280", linewidth=0.8)
        canvas.panel(2 + i, f"{name}: difference", "sensor angle (mrad)", "theodolite − sensor (µrad)")
        canvas.points(2 + i, "held points", sensor, (read - sensor) * 1e3, color=OURS)
        canvas.line(2 + i, f"{name}: fit {100 * gain:.3f} %", span, (gain * span + offset * 1e3) * 1e3, color=OURS)
        paper = paper_tables()["text"].value(f"theodolite {axis}")
        canvas.line(2 + i, f"{name}: paper {100 * paper:.1f} %", span, paper * span * 1e3, color=PAPER, linestyle="--")
    canvas.legend_outside()
    return canvas
