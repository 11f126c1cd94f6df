"""What a figure does not show: curves that leave their axes at the top or bottom, as a sentence for its caption."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from analysis.pages.formats import readable

if TYPE_CHECKING:
    import pandas as pd

    from analysis.pages.canvas import Canvas


def cut_off(canvas: Canvas) -> str:
    """Return a sentence on the curves that leave their axes and how far they go, panel by panel; empty without any.

    What lies to the left or right of the axes does not count.
    """
    panels: dict[int, list[pd.DataFrame]] = {}
    for i, part in canvas.parts:
        panels.setdefault(i, []).append(part)
    said = [text for i, parts in sorted(panels.items()) if (text := _of_panel(canvas, i, parts))]
    return f"Not all is in the frame: {'; '.join(said)}." if said else ""


def _of_panel(canvas: Canvas, i: int, parts: list[pd.DataFrame]) -> str:
    (left, right), (low, high) = sorted(canvas.axes[i].get_xlim()), sorted(canvas.axes[i].get_ylim())
    values = [part["y"][part["x"].between(left, right) & part["y"].notna()].to_numpy() for part in parts]
    y = np.concatenate(values)
    if not y.size or (low <= y.min() and y.max() <= high):
        return ""
    unit = re.search(r"\((.*)\)$", parts[0]["y_quantity"].iloc[0])
    span = f"from {readable(float(y.min()))} to {readable(float(y.max()))}"
    return f"{parts[0]['panel'].iloc[0]} reaches {span}{f' {unit[1]}' if unit else ''}"
