"""Fig. A2: the condition of monotonic convergence for the paper's own repetitive tuning."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.pages.canvas import COLOURS, DASHES, PAPER, Canvas
from analysis.paper.measured import RATE_HZ, Measured
from campaigns.strategies.design import Design
from sim_backend.control.feedback import LEARNING_GAIN_FACTOR, theta_controller
from sim_backend.control.repetitive import TABLE_6_5, convergence, process_sensitivity
from sim_backend.linear import discretise

Array = NDArray[np.float64]

FREQUENCY_HZ = np.concatenate([np.geomspace(1.0, 1000.0, 1500), np.linspace(1001.0, 4999.0, 8000)])
"""Dense enough above 1 kHz for the 1440 Hz mode, which is 11 Hz wide."""


def figure_a2(measured: Measured) -> Canvas:
    """Return |Q (1 − z^γ S_p k_r L)| of both axes over frequency, the feedback open and closed."""
    design = measured.design
    largest = {axis: contraction(design, axis) for axis in TABLE_6_5}
    above = {axis: FREQUENCY_HZ[np.flatnonzero(values > 1.0)] for axis, values in largest.items()}
    said = "; ".join(
        f"{name} at most 1{largest[axis].max() - 1.0:+.2g} at {FREQUENCY_HZ[np.argmax(largest[axis])]:.0f} Hz"
        + (f", above 1 in places from {above[axis].min():.0f} Hz on" if above[axis].size else "")
        for axis, name in (("theta_x", "θx"), ("theta_y", "θy"))
    )
    canvas = Canvas(
        "Convergence of the paper's repetitive control",
        "|Q (1 − z^γ S_p k_r L)| with Q = 1 and k_r, γ and cut-off of Table 6.5, on the design models behind their "
        "hold. Learning shrinks an error by this factor per period; above 1 it grows. With the feedback open: "
        f"{said}. The paper says that it ignores this rule (section 6.5). Dashed: feedback closed, gain × "
        f"{LEARNING_GAIN_FACTOR:g}.",
        rows=2,
        size=(7.2, 5.6),
        share_x=True,
    )
    for i, (axis, name) in enumerate((("theta_x", "θx"), ("theta_y", "θy"))):
        axes = canvas.panel(i, name, "frequency (Hz)" if i else "", "factor per period")
        canvas.line(i, "feedback open", FREQUENCY_HZ, largest[axis], color=COLOURS[0], linestyle=DASHES[0])
        closed = contraction(design, axis, LEARNING_GAIN_FACTOR)
        canvas.line(i, "feedback closed", FREQUENCY_HZ, closed, color=COLOURS[2], linestyle=DASHES[1])
        axes.axhline(1.0, color=PAPER, linewidth=0.9, label="limit of monotonic convergence")
        axes.set_xscale("log")
        axes.set_ylim(*((0.8, 1.1) if axis == "theta_x" else (0.3, 1.3)))
    canvas.legend_outside()
    return canvas


def contraction(design: Design, axis: str, feedback_factor: float = 0.0, modes: int = 1) -> Array:
    """Return the factor (f,) of an axis under Table 6.5; the feedback is open unless it has a factor."""
    plant = discretise(design.axis(axis), RATE_HZ).frequency_response(FREQUENCY_HZ)[:, 0, 0]
    controller = theta_controller().frequency_response(FREQUENCY_HZ) * feedback_factor
    learning = design.learning(axis, round(0.2 * RATE_HZ), modes)
    tuning = TABLE_6_5[axis]
    process = process_sensitivity(plant, controller)
    return convergence(FREQUENCY_HZ, process, learning.filter, tuning.gain, tuning.lead_samples)
