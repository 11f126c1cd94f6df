"""Fig. 6.9: the same fed-forward step of 1 mrad from three offsets, open loop."""

from __future__ import annotations

from analysis.linear.simulate import simulate_linear
from analysis.pages.canvas import OURS, PAPER, Canvas
from analysis.paper.measured import Measured
from campaigns.strategies.design import Design
from sim_backend.linear import discretise

SHOWN_S = 0.12


def figure_6_9(measured: Measured) -> Canvas | None:
    """Return the moves on the bench beside the linear design model's, which does not know the offset."""
    steps = measured.steps("theta_x")
    if not steps:
        return None
    canvas = Canvas(
        "Effect of hysteresis on a fed-forward step",
        "Distance from the start position. The linear design model answers the same at every offset, the bench "
        "does not.",
        columns=len(steps),
        size=(7.2, 3.4),
        share_y=True,
    )
    plant = discretise(Design.load("design-4th-order", 1e4).axis("theta_x"), 1e4)
    for i, step in enumerate(steps):
        end = step.offset_rad + step.step_rad
        title = f"{step.offset_rad * 1e3:.1f} to {end * 1e3:.1f} mrad"
        canvas.panel(i, title, "time (ms)", "moved (mrad)" if i == 0 else "")
        shown = step.time_s <= SHOWN_S
        drive = step.command_nm - step.command_nm[0]
        linear = simulate_linear(plant, drive[:, None])[:, 0]
        canvas.line(i, "bench", step.time_s[shown] * 1e3, step.moved_rad[shown] * 1e3, color=OURS)
        canvas.line(
            i, "linear model", step.time_s[shown] * 1e3, linear[shown] * 1e3, color=PAPER, linestyle="--", linewidth=1.0
        )
        canvas.axes[i].set_ylim(0.9, 1.1)
        canvas.legend(i, loc="lower right", fontsize=7)
    return canvas
