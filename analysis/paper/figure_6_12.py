"""Fig. 6.12: offsets from the mean position at both observation positions."""

from __future__ import annotations

import numpy as np

from analysis.measurements.chop import offsets
from analysis.measurements.settling import BAND_RAD
from analysis.pages.canvas import OURS, Canvas
from analysis.paper.measured import Measured
from analysis.recorded.chop import TIP_TILT

SHOWN = 1500
"""How many samples of each position are drawn, evenly spread; the percentages are over all."""


def figure_6_12(measured: Measured) -> Canvas | None:
    """Return the scatter of the 0 to +8.5 mrad chop at α = 0 in both angles, and the 1.7 µrad circle."""
    chop = measured.chop(0.0, 0.0, 8.5e-3)
    if chop is None:
        return None
    canvas = Canvas(
        "Positional stability in two dimensions",
        f"0 to +8.5 mrad, α = 0°, 0.5 Hz, last 0.5 s of each second; {SHOWN} samples of each position are drawn.",
        columns=2,
        size=(7.2, 4.4),
        share_x=True,
        share_y=True,
    )
    off, result = offsets(chop.windows(*TIP_TILT)) * 1e6, chop.stability()
    for i in range(2):
        level = chop.commanded_rad[i, 0] * 1e3
        inside = f"{result.inside_percent[i]:.2f} % inside"
        axes = canvas.panel(i, f"position {i + 1}: {level:.1f} mrad, {inside}", "θx offset (µrad)", "θy offset (µrad)")
        every = max(off.shape[1] // SHOWN, 1)
        canvas.points(
            i, "samples", off[i, ::every, 0], off[i, ::every, 1], color=OURS, markersize=1.6, alpha=0.5, mew=0
        )
        canvas.circle(i, BAND_RAD * 1e6, "1.7 µrad")
        axes.set_aspect("equal")
        limit = 1.05 * max(float(np.max(np.abs(off))), BAND_RAD * 1e6)
        axes.set_xlim(-limit, limit)
        axes.set_ylim(-limit, limit)
    canvas.legend_outside()
    return canvas
