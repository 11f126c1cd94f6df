"""Fig. 6.14: a 5 Hz chop in θy under the hybrid and the repetitive controller."""

from __future__ import annotations

import numpy as np

from analysis.pages.canvas import OURS, PAPER, Canvas
from analysis.paper.measured import Measured

SHOWN_S = 5.0


def figure_6_14(measured: Measured) -> Canvas | None:
    """Return the angle over the first five seconds of both strategies, and the error near each commanded position."""
    found = [(name, measured.settle(name, 90.0)) for name in ("hybrid", "repetitive")]
    canvas = Canvas(
        "5 Hz chop in θy, hybrid and repetitive",
        "From the start of the run; dotted: the commanded positions. The repetitive controller learns for 4.7 s, then "
        "its input is kept and the feedback closes.",
        rows=2,
        size=(7.2, 4.8),
        share_x=True,
    )
    if any(phase is None for _, phase in found):
        return None
    for i, (name, phase) in enumerate(found):
        assert phase is not None
        angle = phase.run.read("theta_y")
        t = np.arange(angle.size) / phase.rate_hz
        axes = canvas.panel(i, f"{name} controller", "time (s)" if i else "", "θy (mrad)")
        canvas.line(i, name, t[t <= SHOWN_S], angle[t <= SHOWN_S] * 1e3, color=OURS, linewidth=0.8)
        for level in phase.commanded_rad[:, 1]:
            axes.axhline(level * 1e3, color=PAPER, linestyle=":", linewidth=0.9)
    return canvas
