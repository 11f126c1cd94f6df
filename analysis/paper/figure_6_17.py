"""Fig. 6.17: sweeps at 77 K and at 63.5 K."""

from __future__ import annotations

import numpy as np

from analysis.pages.canvas import COLOURS, OURS, PAPER, Canvas
from analysis.paper.measured import COLD_K, WARM_K, Measured
from analysis.recorded.sweep import difference_of


def figure_6_17(measured: Measured) -> Canvas | None:
    """Return both magnitudes of either angle, and their difference with its uncertainty."""
    canvas = Canvas(
        "Frequency response at two temperatures",
        "Open-loop sweeps from 5 to 100 Hz. Right: difference with one standard deviation of the noise. The paper "
        "detects no variation in the plot of the magnitudes.",
        rows=2,
        columns=2,
        size=(7.2, 5.0),
        share_x=True,
    )
    for row, (axis, name) in enumerate((("theta_x", "θx"), ("theta_y", "θy"))):
        both = measured.temperatures(axis)
        if both is None:
            return None
        warm, cold = both
        found = difference_of(warm, cold)
        last = "frequency (Hz)" if row else ""
        left, right = 2 * row, 2 * row + 1
        canvas.panel(left, name, last, "magnitude (dB re 1 mrad/N m)")
        canvas.line(left, f"{WARM_K:g} K", warm.frequency_hz, warm.magnitude_db + 60.0, color=OURS)
        canvas.line(left, f"{COLD_K:g} K", cold.frequency_hz, cold.magnitude_db + 60.0, color=PAPER, linestyle="--")
        title = f"{name}: largest {found.largest_db:+.2f} dB at {found.largest_hz:g} Hz"
        canvas.panel(right, title, last, "difference (dB)")
        canvas.points(right, "63.5 K over 77 K", warm.frequency_hz, found.difference_db, color=COLOURS[2])
        canvas.axes[right].errorbar(
            warm.frequency_hz, found.difference_db, found.std_db, fmt="none", ecolor=COLOURS[2], linewidth=0.8
        )
        canvas.axes[left].set_xscale("log")
        canvas.axes[right].set_ylim(*_around(found.difference_db))
    canvas.legend_outside()
    return canvas


def _around(values: np.ndarray) -> tuple[float, float]:
    reach = max(1.2 * float(np.max(np.abs(values))), 0.1)
    return -reach, reach
