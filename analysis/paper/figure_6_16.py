"""Fig. 6.16: mean chopped positions over five minutes."""

from __future__ import annotations

from analysis.measurements.settling import BAND_RAD
from analysis.pages.canvas import OURS, Canvas
from analysis.paper.measured import Measured


def figure_6_16(measured: Measured) -> Canvas | None:
    """Return every integration period's mean position as an offset from the mean of all, both angles and positions."""
    test = measured.drift()
    if test is None:
        return None
    warming = "" if test.warming_k is None else f" The mechanism warmed by {test.warming_k:.2f} K."
    canvas = Canvas(
        "Repeatability of chopped positions over five minutes",
        "5 Hz chop over 8.5 mrad in θy, hybrid controller; one dot per integration period. Drift over the whole test "
        f"with one standard deviation. Shaded: ±1.7 µrad.{warming}",
        rows=2,
        columns=2,
        size=(7.2, 4.8),
        share_x=True,
        share_y=True,
    )
    offset = test.offset_rad * 1e6
    for position in range(2):
        for axis, name in enumerate(("θx", "θy")):
            i = 2 * position + axis
            found = test.drift[position]
            drift = f"{1e6 * found.total_rad[axis]:+.3f} ± {1e6 * found.std_rad[axis]:.3f} µrad"
            canvas.panel(
                i,
                f"{name}, position {position + 1}: drift {drift}",
                "time (s)" if position else "",
                "offset (µrad)" if axis == 0 else "",
            )
            canvas.points(
                i, "mean", test.time_s[position], offset[position, :, axis], color=OURS, markersize=1.4, mew=0
            )
            canvas.band(i, -BAND_RAD * 1e6, BAND_RAD * 1e6, "±1.7 µrad")
    return canvas
