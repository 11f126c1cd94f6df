"""Fig. 6.13: histograms of the offsets with Gaussian fits."""

from __future__ import annotations

import numpy as np

from analysis.measurements.chop import offsets
from analysis.measurements.gaussian import BIN_RAD, gaussian_fit
from analysis.pages.canvas import OURS, PAPER, Canvas
from analysis.paper.measured import Measured
from analysis.recorded.chop import TIP_TILT


def figure_6_13(measured: Measured) -> Canvas | None:
    """Return the histogram of either angle at either position, bins of 0.1 µrad, and its bell curve."""
    chop = measured.chop(0.0, 0.0, 8.5e-3)
    if chop is None:
        return None
    canvas = Canvas(
        "Histograms of the positional stability",
        "0 to +8.5 mrad, α = 0°, as in Fig. 6.12, all samples, bins of 0.1 µrad. σ of the least-squares Gaussian.",
        rows=2,
        columns=2,
        size=(7.2, 5.0),
        share_x=True,
    )
    off = offsets(chop.windows(*TIP_TILT))
    for position in range(2):
        for axis, name in enumerate(("θx", "θy")):
            i = 2 * position + axis
            fit = gaussian_fit(off[position, :, axis])
            title = f"{name}, position {position + 1}: 3σ = {3e6 * fit.sigma_rad:.2f} µrad"
            canvas.panel(i, title, "offset (µrad)" if position else "", "samples" if axis == 0 else "")
            canvas.bars(i, "samples", fit.centre_rad * 1e6, fit.count, BIN_RAD * 0.9e6, color=OURS, alpha=0.55)
            x = np.linspace(fit.centre_rad[0], fit.centre_rad[-1], 300)
            canvas.line(i, "Gaussian fit", x * 1e6, fit.curve(x), color=PAPER)
    canvas.legend_outside()
    return canvas
