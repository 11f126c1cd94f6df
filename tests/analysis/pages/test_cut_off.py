"""A caption says which curves leave the frame."""

import numpy as np

from analysis.pages.canvas import Canvas
from analysis.pages.cut_off import cut_off


def drawn(limits=None, left=None):
    canvas = Canvas("t", "c", rows=2)
    for i, name in enumerate(("first", "second")):
        canvas.panel(i, name, "time (ms)", "error (µrad)")
        canvas.line(i, "curve", np.arange(5.0), np.array([-8500.0, 52.0, np.nan, 1.0, 0.5]))
    if limits is not None:
        canvas.axes[0].set_ylim(*limits)
    if left is not None:
        canvas.axes[0].set_xlim(left, 4.0)
    return cut_off(canvas)


def test_nothing_is_said_where_all_is_seen():
    assert drawn() == ""
    # what is cut off lies to the left of the axes
    assert drawn(limits=(-10.0, 10.0), left=2.0) == ""


def test_what_leaves_the_frame_is_named_with_its_panel_and_unit():
    assert drawn(limits=(-10.0, 10.0)) == "Not all is in the frame: first reaches from −8,500 to 52 µrad."
    # an axis may be upside down
    assert drawn(limits=(10.0, -10.0), left=1.0) == "Not all is in the frame: first reaches from 0.5 to 52 µrad."
