"""Fig. 6.15: tracking error at 8.5 mrad after convergence."""

from __future__ import annotations

import numpy as np

from analysis.measurements.settling import BAND_RAD
from analysis.pages.canvas import COLOURS, DASHES, Canvas
from analysis.paper.measured import Measured

STRATEGIES = {"hybrid": "hybrid", "repetitive": "repetitive", "mbff": "MbFF", "designed": "this project"}
SHOWN_S = 0.06
REACH_URAD = 10.0
"""Shown about the position: the band of 1.7 µrad is a sixth of it."""


def figure_6_15(measured: Measured) -> Canvas | None:
    """Return the error of the mean move to 8.5 mrad under every strategy, in θx and θy."""
    canvas = Canvas(
        "Tracking error after convergence",
        "Move to 8.5 mrad, mean over the cycles of a 5 Hz chop; time from the start of the move. The legend has the "
        "settling times; never: not before the next move. Shaded: ±1.7 µrad. Paper: repetitive control settles in "
        "32 ms (θx) and 5.6 ms (θy).",
        rows=2,
        size=(7.2, 5.2),
        share_x=True,
    )
    drawn = 0
    for i, (axis, name, alpha) in enumerate((("theta_x", "θx", 0.0), ("theta_y", "θy", 90.0))):
        axes = canvas.panel(i, name, "time (ms)" if i else "", "error (µrad)")
        for k, (strategy, label) in enumerate(STRATEGIES.items()):
            phase = measured.settle(strategy, alpha)
            if phase is None:
                continue
            error = phase.moves(2, axis) - phase.commanded_rad[1, i]
            shown = np.arange(error.size) <= SHOWN_S * phase.rate_hz
            t = np.arange(error.size)[shown] / phase.rate_hz * 1e3
            settled = phase.settling(axis).time_s[1] * 1e3
            reached = f"{label}: {settled:.1f} ms" if np.isfinite(settled) else f"{label}: never"
            canvas.line(i, reached, t, error[shown] * 1e6, color=COLOURS[k], linestyle=DASHES[k], linewidth=1.2)
            drawn += 1
        canvas.band(i, -BAND_RAD * 1e6, BAND_RAD * 1e6, "±1.7 µrad")
        axes.set_ylim(-REACH_URAD, REACH_URAD)
    for i in range(2):
        canvas.legend_above(i, 2)
    return canvas if drawn else None
