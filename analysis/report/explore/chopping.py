"""How still each position of a slow chop is held, by direction and end points."""

from __future__ import annotations

import numpy as np

from analysis.measurements.chop import offsets
from analysis.measurements.settling import BAND_RAD
from analysis.pages.explorer import Explorer, Facts, Panel, Series, View
from analysis.paper.measured import Measured
from analysis.recorded.chop import TIP_TILT, ChopPhase
from analysis.report.explore.settling import direction

POINTS = 600
"""Longest curve here: noise fills its band however many of its samples are drawn."""

AXES = ("θx", "θy")


def chopping(measured: Measured) -> Explorer | None:
    """Return the offsets in the observation windows over time; None where the campaign holds no slow chop."""
    views: dict[tuple[str, ...], View] = {}
    for chosen in measured.settings("chop"):
        alpha, start, end = (float(chosen[name]) for name in ("alpha_deg", "from_rad", "to_rad"))
        chop = measured.chop(alpha, start, end)
        if chop is not None:
            form = f"{1e3 * start:g} to {1e3 * end:+g} mrad".replace("-", "−")
            for position in (1, 2):
                views[direction(alpha), form, str(position)] = _view(chop, position)
    if not views:
        return None
    names = ("direction", "form", "position")
    return Explorer(
        "chopping",
        "Stillness of a slow chop",
        "Offset from the mean position in all observation windows, one after another, under hybrid control. "
        "Shaded: ±1.7 µrad.",
        {name: tuple(dict.fromkeys(chosen[i] for chosen in views)) for i, name in enumerate(names)},
        views,
    )


def _view(chop: ChopPhase, position: int) -> View:
    off, found = offsets(chop.windows(*TIP_TILT))[position - 1] * 1e6, chop.stability()
    time_s = np.arange(off.shape[0]) / chop.rate_hz
    band = (-BAND_RAD * 1e6, BAND_RAD * 1e6, "±1.7 µrad")
    panels = tuple(
        Panel(
            "observed (s)",
            f"{name} offset (µrad)",
            (Series.of(name, time_s, off[:, axis], most=POINTS),),
            band=band,
        )
        for axis, name in enumerate(AXES)
    )
    rows = tuple(
        (
            f"{i + 1}",
            (
                *(1e6 * float(sigma) for sigma in found.three_sigma_rad[i]),
                float(found.inside_percent[i]),
                1e6 * float(found.accuracy_rad[i]),
            ),
        )
        for i in range(2)
    )
    heads = ("position", "θx, 3σ (µrad)", "θy, 3σ (µrad)", "within 1.7 µrad (%)", "mean from command (µrad)")
    return View(panels, Facts(heads, rows))
