"""Fig. 6.18: repetitive, MbFF and hybrid control, all with the learned input."""

from __future__ import annotations

import numpy as np

from analysis.measurements.settling import BAND_RAD
from analysis.pages.canvas import COLOURS, DASHES, Canvas
from analysis.paper.measured import Measured

STRATEGIES = {
    "repetitive": "repetitive",
    "learned-mbff": "MbFF, learned input",
    "learned-hybrid": "hybrid, learned input",
}
SHOWN_S = 0.06
REACH_URAD = 10.0


def figure_6_18(measured: Measured) -> Canvas | None:
    """Return the last move to 8.5 mrad of each strategy that uses the learned input, close up, in θx and θy."""
    canvas = Canvas(
        "Strategies with the learned input",
        "Close-up at 8.5 mrad after convergence, the last move of each run (θy: 10 s after the start where recorded; "
        "θx: after 10 s of learning). The paper shows θy. Shaded: ±1.7 µrad.",
        rows=2,
        size=(7.2, 5.2),
        share_x=True,
    )
    drawn = 0
    for i, (axis, name, alpha) in enumerate((("theta_x", "θx", 0.0), ("theta_y", "θy", 90.0))):
        axes = canvas.panel(i, name, "time (ms)" if i else "", f"{name} − 8.5 mrad (µrad)")
        for k, (strategy, label) in enumerate(STRATEGIES.items()):
            phase = measured.settle(strategy, alpha)
            if phase is None:
                continue
            last = phase.cycles(axis)[-1, : phase.dwell] - phase.commanded_rad[1, i]
            shown = np.arange(last.size) <= SHOWN_S * phase.rate_hz
            t = np.arange(last.size)[shown] / phase.rate_hz * 1e3
            canvas.line(i, label, t, last[shown] * 1e6, color=COLOURS[k], linestyle=DASHES[k])
            drawn += 1
        canvas.band(i, -BAND_RAD * 1e6, BAND_RAD * 1e6, "±1.7 µrad")
        axes.set_ylim(-REACH_URAD, REACH_URAD)
        axes.set_xlim(3.0, SHOWN_S * 1e3)
    canvas.legend_outside(3)
    return canvas if drawn else None
