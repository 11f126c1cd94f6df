"""The curves of a Bode diagram."""

from __future__ import annotations

import numpy as np

from analysis.pages.bode import bode_canvas, draw_response


def test_a_phase_that_wraps_is_drawn_at_every_frequency_and_not_across_the_picture():
    canvas = bode_canvas("T", "entry", "rad", (5.2, 4.2))
    f, phase_deg = np.arange(1.0, 6.0), np.array([170.0, 179.0, -179.0, 179.0, -170.0])
    draw_response(canvas, "curve", f, np.exp(1j * np.radians(phase_deg)))
    x, y = (np.asarray(part) for part in canvas.axes[1].lines[0].get_data())
    drawn = np.isfinite(y)
    assert np.array_equal(x[drawn], f) and np.allclose(y[drawn], phase_deg)
    lines = np.split(y, np.flatnonzero(~drawn))
    assert all(np.ptp(line[np.isfinite(line)]) < 180.0 for line in lines)
    assert np.array_equal(canvas.axes[0].lines[0].get_xdata(), f)
