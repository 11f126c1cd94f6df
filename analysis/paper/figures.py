"""Every figure of the report. FIGURES is the only list: a figure is one file and one line here.

Those with A show what the paper prints no figure of.
"""

from __future__ import annotations

from collections.abc import Callable

from analysis.pages.canvas import Canvas
from analysis.paper.figure_6_4 import figure_6_4
from analysis.paper.figure_6_5 import figure_6_5
from analysis.paper.figure_6_7 import figure_6_7
from analysis.paper.figure_6_9 import figure_6_9
from analysis.paper.figure_6_10 import figure_6_10
from analysis.paper.figure_6_11 import figure_6_11
from analysis.paper.figure_6_12 import figure_6_12
from analysis.paper.figure_6_13 import figure_6_13
from analysis.paper.figure_6_14 import figure_6_14
from analysis.paper.figure_6_15 import figure_6_15
from analysis.paper.figure_6_16 import figure_6_16
from analysis.paper.figure_6_17 import figure_6_17
from analysis.paper.figure_6_18 import figure_6_18
from analysis.paper.figure_a1 import figure_a1
from analysis.paper.figure_a2 import figure_a2
from analysis.paper.figure_a3 import figure_a3
from analysis.paper.measured import Measured

FIGURES: dict[str, Callable[[Measured], Canvas | None]] = {
    "6.4": figure_6_4,
    "6.5": figure_6_5,
    "6.7": figure_6_7,
    "6.9": figure_6_9,
    "6.10": figure_6_10,
    "6.11": figure_6_11,
    "6.12": figure_6_12,
    "6.13": figure_6_13,
    "6.14": figure_6_14,
    "6.15": figure_6_15,
    "6.16": figure_6_16,
    "6.17": figure_6_17,
    "6.18": figure_6_18,
    "A1": figure_a1,
    "A2": figure_a2,
    "A3": figure_a3,
}


def make_figure(key: str, measured: Measured) -> Canvas | None:
    """Return one figure with the runs that it rests on, or None where the campaign lacks them."""
    with measured.tracing() as uids:
        canvas = FIGURES[key](measured)
    if canvas is not None:
        canvas.run_uids = tuple(sorted(uids))
    return canvas
