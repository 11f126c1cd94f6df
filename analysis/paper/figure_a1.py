"""Fig. A1: every length of the feed-forward of Table 6.4 compared with its rows."""

from __future__ import annotations

import numpy as np

from analysis.pages.canvas import COLOURS, DASHES, PAPER, Canvas
from analysis.paper.measured import Measured
from analysis.paper.move_length import (
    CALIBRATED_ON,
    CUT,
    LONGEST,
    NORMS,
    RINGING,
    SEARCHED,
    calibrated_samples,
    cut_deviations,
    deviations,
    norm_deviations,
)


def figure_a1(measured: Measured) -> Canvas:
    """Return each row's deviation from the printed number over the length, and the worst under other norms."""
    chosen = calibrated_samples()
    canvas = Canvas(
        "How long the feed-forward of Table 6.4 lasted",
        "Deviation of our overshoot and settling from the printed ones by the length of the least-norm feed-forward at "
        f"10 kHz. {chosen} samples were calibrated on the overshoot of 30+{CALIBRATED_ON.split('+')[1]} Hz; the text "
        f"says 5 ms, {LONGEST} samples. Below: the worst of the four overshoots if another norm is made least, or if "
        f"the feed-forward of {LONGEST} samples is broken off.",
        rows=3,
        size=(7.2, 8.2),
    )
    lengths = np.array(SEARCHED)
    found = [deviations(n) for n in SEARCHED]
    for panel, name in enumerate(("overshoot", "settling")):
        canvas.panel(panel, name, "", f"deviation of {name} (%)")
        for k, key in enumerate(RINGING):
            values = 100.0 * np.array([one[key][panel] for one in found])
            style = {"color": COLOURS[k], "linestyle": DASHES[k], "marker": "o", "markersize": 3.0}
            canvas.line(panel, key if key == "complete" else f"{key} Hz", lengths, values, **style)
        canvas.axes[panel].axhline(0.0, color="#6b7280", linewidth=0.8)
        canvas.axes[panel].set_ylim(-110.0, 180.0 if panel == 0 else 70.0)
    canvas.panel(2, "other norms", "length (samples)", "worst deviation of overshoot (%)")
    longer = np.arange(40, 65)
    for k, norm in enumerate(NORMS):
        canvas.line(
            2, f"least {norm}", longer, 100.0 * norm_deviations(norm), color=COLOURS[k], linestyle=DASHES[k], marker=""
        )
    style = {"color": COLOURS[len(NORMS)], "linestyle": "", "marker": "s", "markersize": 3.0}
    canvas.line(2, f"{LONGEST} samples, broken off", np.array(CUT), 100.0 * cut_deviations(), **style)
    # what is broken off misses a thousandfold as much as the best: no linear scale shows both
    canvas.axes[2].set_yscale("log")
    for axes in canvas.axes:
        axes.axvline(chosen, color=PAPER, linewidth=0.8, linestyle=":")
        axes.set_xticks(np.arange(40, 65 if axes is canvas.axes[2] else 58, 2))
    canvas.legend_above(0, 2)
    canvas.legend(2, loc="upper right", bbox_to_anchor=(1.0, -0.32), ncols=2, borderpad=0.0, columnspacing=1.0)
    return canvas
