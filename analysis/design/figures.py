"""The figures of a design: margins with their band, convergence, noise, and the move."""

from __future__ import annotations

import math

import numpy as np

from analysis.design.api import Designed
from analysis.design.feedback import PEAK_DB, frequency_grid
from analysis.design.price import PAPER
from analysis.design.uncertainty import drawn_plants
from analysis.pages.canvas import COLOURS, OURS, Canvas
from sim_backend.axis_names import axis_text
from sim_backend.linear import discretise


def design_figures(designed: Designed) -> dict[str, Canvas]:
    """Return the figures by name."""
    return {
        "sensitivity": _sensitivity(designed),
        "convergence": _convergence(designed),
        "noise": _noise(designed),
        "move": _move(designed),
        "price": _price(designed),
    }


def _grid(designed: Designed, title: str, caption: str) -> Canvas:
    return Canvas(title, caption, columns=len(designed.axes), size=(4.2 * len(designed.axes), 3.6))


def _sensitivity(designed: Designed) -> Canvas:
    options = designed.options
    canvas = _grid(
        designed,
        "Sensitivity",
        f"|S| of the closed loop on the identified plant, and the band of {options.plants} plants drawn within its "
        f"uncertainty. Their limit is {PEAK_DB:g} dB.",
    )
    for i, one in enumerate(designed.axes):
        axes = canvas.panel(i, axis_text(one.dof), "frequency (Hz)", "|S| (dB)")
        rng = np.random.default_rng(options.seed)
        model, reach_rad = designed.controller.model, options.reach_rad
        plants = drawn_plants(model, one.dof, options.tolerance, options.plants, rng, reach_rad)
        rate = designed.controller.sample_rate_hz
        f = frequency_grid(plants[0], rate)
        f = f[f >= 0.5]
        k = one.feedback.controller.frequency_response(f)
        responses = [discretise(p, rate).frequency_response(f)[:, 0, 0] for p in plants]
        s_db = np.array([-20.0 * np.log10(np.abs(1.0 + p * k)) for p in responses])
        canvas.line(i, "lowest drawn", f, s_db.min(axis=0), color=COLOURS[5], linewidth=0.7)
        canvas.line(i, "highest drawn", f, s_db.max(axis=0), color=COLOURS[5], linewidth=0.7)
        canvas.line(i, "identified", f, s_db[0], color=OURS, linewidth=1.2)
        axes.axhline(PEAK_DB, color=COLOURS[1], linewidth=0.8, linestyle="--")
        axes.set_xscale("log")
        axes.set_ylim(-60.0, 10.0)
    canvas.legend_outside()
    return canvas


def _convergence(designed: Designed) -> Canvas:
    canvas = _grid(
        designed,
        "Convergence of learning",
        "What an error shrinks to in one period with the steady gain, by frequency: on the identified plant, on the "
        "worst drawn one, and at the measured lines with their 2σ bound. Above 1 it grows.",
    )
    for i, one in enumerate(designed.axes):
        axes = canvas.panel(i, axis_text(one.dof), "frequency (Hz)", "factor per period")
        learned = one.learning
        canvas.line(i, "worst drawn", learned.frequency_hz, learned.worst, color=COLOURS[5], linewidth=0.8)
        canvas.line(i, "identified", learned.frequency_hz, learned.factor, color=OURS, linewidth=1.2)
        if learned.lines_hz is not None and learned.at_lines_worst is not None:
            canvas.points(
                i, "measured + 2σ", learned.lines_hz, learned.at_lines_worst, color=COLOURS[1], markersize=2.5
            )
        axes.axhline(1.0, color=COLOURS[1], linewidth=0.8, linestyle="--")
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_ylim(1e-4, 2.0)
        canvas.legend(i, loc="lower left")
    return canvas


def _noise(designed: Designed) -> Canvas:
    canvas = _grid(
        designed,
        "Noise at rest",
        "Density of the reading with all loops open, and the torque and reading noise fitted to it. Lines near the "
        "modes took no part.",
    )
    for i, one in enumerate(designed.axes):
        axes = canvas.panel(i, axis_text(one.dof), "frequency (Hz)", "reading (nrad/√Hz)")
        noise = one.noise
        canvas.line(i, "measured", noise.frequency_hz, 1e9 * np.sqrt(noise.measured), color=COLOURS[5], linewidth=0.6)
        canvas.line(i, "fitted", noise.frequency_hz, 1e9 * np.sqrt(noise.fitted), color=OURS, linewidth=1.2)
        axes.set_xscale("log")
        axes.set_yscale("log")
        canvas.legend(i, loc="upper right")
    return canvas


def _move(designed: Designed) -> Canvas:
    canvas = Canvas(
        "The move",
        "Reference of a move over the designed stroke and the torque fed forward for it, before anything is learned.",
        rows=2,
        columns=len(designed.axes),
        size=(4.2 * len(designed.axes), 5.0),
        share_x=True,
    )
    for i, one in enumerate(designed.axes):
        shown = one.time_s <= 2.0 * one.price.allowed_s
        t = 1e3 * one.time_s[shown]
        canvas.panel(i, axis_text(one.dof), "", "angle (mrad)")
        canvas.line(i, "reference", t, 1e3 * one.price.motion_rad[shown], color=OURS, linewidth=1.2)
        below = i + len(designed.axes)
        canvas.panel(below, f"{axis_text(one.dof)}, torque", "time (ms)", "torque (N m)")
        canvas.line(below, "fed forward", t, one.price.drive_nm[shown], color=COLOURS[1], linewidth=1.2)
    return canvas


def _price(designed: Designed) -> Canvas:
    # a bench that does not say what its coils dissipate has no power to show
    stated = not any(math.isnan(one.price.power_w) for one in designed.axes)
    canvas = Canvas(
        "The price of a fast move",
        f"{'Power and peak current' if stated else 'Peak current'} of a 5 Hz chop over "
        f"{1e3 * designed.options.reach_rad:g} mrad, by the time in which "
        "its moves arrive. The circle is this design, the cross what the paper achieved (over 8.5 mrad).",
        rows=2 if stated else 1,
        columns=len(designed.axes),
        size=(4.2 * len(designed.axes), 5.0 if stated else 2.8),
        share_x=True,
    )
    for i, one in enumerate(designed.axes):
        arrival = [1e3 * point.move.arrival_s for point in one.curve]
        rows = (
            ("power (W)", [p.power_w for p in one.curve], one.price.power_w, PAPER[one.dof][1]),
            ("peak current (A)", [p.peak_a for p in one.curve], one.price.peak_a, PAPER[one.dof][2]),
        )
        shown = rows if stated else rows[1:]
        for row, (label, values, own, paper) in enumerate(shown):
            at = i + row * len(designed.axes)
            axes = canvas.panel(at, axis_text(one.dof), "settling (ms)" if row == len(shown) - 1 else "", label)
            canvas.line(at, "this project", arrival, values, color=OURS, linewidth=1.2)
            canvas.points(at, "this design", [1e3 * one.price.move.arrival_s], [own], color=OURS, markersize=6.0)
            canvas.points(at, "paper", [1e3 * PAPER[one.dof][0]], [paper], color=COLOURS[1], marker="x", markersize=7.0)
            axes.set_xscale("log")
            axes.set_yscale("log")
            canvas.legend(at, loc="upper right")
    return canvas
