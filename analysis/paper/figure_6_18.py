"""Fig. 6.18: repetitive, MbFF and hybrid control, all with the learned input."""

from __future__ import annotations

import numpy as np

from analysis.measurements.settling import BAND_RAD
from analysis.pages.canvas import COLOURS, Canvas
from analysis.paper.measured import Measured

STRATEGIES = {
    "repetitive": "repetitive",
    "learned-mbff": "MbFF, learned input",
    "learned-hybrid": "hybrid, learned input",
}
SHOWN_S = 0.03


def figure_6_18(measured: Measured) -> Canvas | None:
    """Return the last move to 8.5 mrad of each strategy that uses the learned input, close up."""
    canvas = Canvas(
        "Strategies with the learned input",
        "Close-up at 8.5 mrad in θy after convergence, the last move of each run (10 s after the start where recorded)."
        " Shaded: ±1.7 µrad.",
        size=(7.2, 3.8),
    )
    axes = canvas.panel(0, "", "time (ms)", "θy − 8.5 mrad (µrad)")
    drawn = 0
    for k, (strategy, label) in enumerate(STRATEGIES.items()):
        phase = measured.settle(strategy, 90.0)
        if phase is None:
            continue
        last = phase.cycles("theta_y")[-1, : phase.dwell] - phase.commanded_rad[1, 1]
        shown = np.arange(last.size) <= SHOWN_S * phase.rate_hz
        canvas.line(0, label, np.arange(last.size)[shown] / phase.rate_hz * 1e3, last[shown] * 1e6, color=COLOURS[k])
        drawn += 1
    canvas.band(0, -BAND_RAD * 1e6, BAND_RAD * 1e6, "±1.7 µrad")
    axes.set_ylim(-6.0, 6.0)
    axes.set_xlim(3.0, SHOWN_S * 1e3)
    canvas.legend(0, loc="upper right")
    return canvas if drawn else None
