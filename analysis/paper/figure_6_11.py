"""Fig. 6.11: convergence of the repetitive controller in θy, bench and simulation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.pages.canvas import OURS, PAPER, Canvas
from analysis.paper.measured import Measured
from analysis.paper.table_text import in_step
from analysis.recorded.chop import ChopPhase
from campaigns.plans import make_plan
from sim_backend.model import load_model
from sim_backend.simbench import SimBench

Array = NDArray[np.float64]

FROM_S = 1.0
"""The paper shows the convergence from here on."""


def figure_6_11(measured: Measured) -> Canvas | None:
    """Return the tracking error over time, and its rms in every period, of the bench and of the linear design model."""
    learning = measured.settle("repetitive", 90.0, "learning")
    if learning is None:
        return None
    canvas = Canvas(
        "Convergence of repetitive control in θy",
        "Chop of 5 Hz between 0 and 8.5 mrad, from 1 s on. Simulation: the linear design "
        "model. Error from the commanded position outside the 5 ms moves; the feedback "
        "closes after 4.7 s. The paper counts 12 iterations.",
        rows=2,
        size=(7.2, 5.2),
    )
    canvas.panel(0, "tracking error", "time (s)", "error (µrad)")
    canvas.panel(1, "per period", "iteration", "rms error (µrad)")
    for name, angle, colour, width in (
        ("bench", learning.run.read("theta_y"), OURS, 0.9),
        ("simulation", _simulated(learning), PAPER, 1.2),
    ):
        error = tracking_error(learning, angle) * 1e6
        t = np.arange(error.size) / learning.rate_hz
        later = t >= FROM_S
        canvas.line(0, name, t[later], error[later], color=colour, linewidth=width)
        per_period = error[: error.size // learning.period * learning.period].reshape(-1, learning.period)
        rms = np.sqrt(np.nanmean(per_period**2, axis=1))
        canvas.line(1, name, np.arange(1, rms.size + 1), rms, color=colour, marker="o")
    closes = learning.stop / learning.rate_hz
    canvas.axes[0].axvline(closes, color="#6b7280", linewidth=0.8, linestyle=":", label="feedback closes")
    canvas.axes[1].axvline(12, color=PAPER, linewidth=0.8, linestyle=":", label="paper: converged")
    canvas.axes[0].set_ylim(-60.0, 60.0)
    canvas.axes[1].set_yscale("log")
    for i in (0, 1):
        canvas.legend(i, loc="upper right")
    return canvas


def tracking_error(phase: ChopPhase, angle: Array) -> Array:
    """Return angle (n,) minus the commanded position, not a number during the moves; `angle` starts with the phase."""
    commanded = np.repeat(phase.commanded_rad[::-1, 1], phase.dwell)
    moving = in_step(phase.dwell, phase.rate_hz)
    periods = -(-angle.size // phase.period)
    error = angle - np.tile(commanded, periods)[: angle.size]
    return np.where(np.tile(moving, periods)[: angle.size], np.nan, error)


def _simulated(phase: ChopPhase) -> Array:
    """θy of the same plan on the linear design model: no noise, no hysteresis."""
    plan = make_plan("settling", phase.run.header.settings)
    bench = SimBench(load_model("design"), 0)
    return np.concatenate([bench.play(segment).channels["theta_y"] for segment in plan.segments(bench)])
