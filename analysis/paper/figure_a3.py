"""Fig. A3: settling of θx under repetitive control over the seeds of the noise."""

from __future__ import annotations

import numpy as np

from analysis.pages.canvas import COLOURS, PAPER, Canvas
from analysis.paper.measured import Measured
from analysis.paper.numbers import paper_tables
from analysis.paper.settling_seeds import settling_seeds
from analysis.paper.table_6_6 import PAPER as PLAYED
from analysis.paper.table_6_6 import settled_s


def figure_a3(measured: Measured) -> Canvas:
    """Return the share of seeds that have settled over time, beside the paper's time and this campaign's."""
    seeds, paper_ms = settling_seeds(), paper_tables()["6.6"].printed("settling theta_x")
    times_ms = 1e3 * seeds.settling_s
    low, high = seeds.quantile_ms(0.05), seeds.quantile_ms(0.95)
    canvas = Canvas(
        "Settling of θx depends on the noise",
        f"Share of {times_ms.size} seeds of the bundled bench whose mean move has settled within ±1.7 µrad, after "
        f"{seeds.learning_s:g} s of repetitive learning (in the repository: {seeds.source}). From 5 to 95 % of the "
        f"seeds it takes {low:.1f} to {high:.1f} ms, in groups: one of a few swings is the last to leave the band.",
        size=(7.2, 3.4),
    )
    canvas.panel(0, "", "settling time (ms)", "share of the seeds (%)")
    share = 100.0 * np.arange(1, times_ms.size + 1) / times_ms.size
    canvas.line(0, "seeds", times_ms, share, color=COLOURS[0], drawstyle="steps-post")
    canvas.line(0, "paper", np.full(2, paper_ms), np.array([0.0, 100.0]), color=PAPER, linestyle=":")
    ours_s = settled_s(measured, PLAYED.fast, "theta_x")
    if ours_s is not None and np.isfinite(ours_s):
        ours = np.full(2, 1e3 * ours_s)
        canvas.line(0, "this campaign", ours, np.array([0.0, 100.0]), color=COLOURS[2], linestyle="--")
    canvas.legend_above(0)
    return canvas
