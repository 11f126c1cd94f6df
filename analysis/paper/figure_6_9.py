"""Fig. 6.9: the same fed-forward step of 1 mrad from three offsets, open loop."""

from __future__ import annotations

from analysis.linear.simulate import simulate_linear
from analysis.pages.canvas import COLOURS, DASHES, OURS, PAPER, Canvas
from analysis.paper.measured import Measured
from campaigns.strategies.design import Design
from sim_backend.linear import discretise

SHOWN_S = 0.12


def figure_6_9(measured: Measured) -> Canvas | None:
    """Return the mean moves on the bench beside those of the linear and of the fitted nonlinear model."""
    steps = measured.steps("theta_x")
    if not steps:
        return None
    models = measured.model_steps("theta_x") or []
    canvas = Canvas(
        "Effect of hysteresis on a fed-forward step",
        f"Distance from the start position, the mean of {steps[0].repeats} moves on the bench. The linear design model "
        "answers the same at every offset; the nonlinear one has the hysteresis and the polynomial fitted to the loops "
        "of Fig. 6.7.",
        columns=len(steps),
        size=(7.2, 3.4),
        share_y=True,
    )
    plant = discretise(Design.load("design-4th-order", 1e4).axis("theta_x"), 1e4)
    for i, step in enumerate(steps):
        end = step.offset_rad + step.step_rad
        title = f"{step.offset_rad * 1e3:.1f} to {end * 1e3:.1f} mrad"
        canvas.panel(i, title, "time (ms)", "moved (mrad)" if i == 0 else "")
        drive = step.command_nm - step.command_nm[0]
        linear = simulate_linear(plant, drive[:, None])[:, 0]
        curves = [("bench", step.time_s, step.moved_rad, OURS), ("linear model", step.time_s, linear, PAPER)]
        if models:
            curves.append(("nonlinear model", models[i].time_s, models[i].moved_rad, COLOURS[2]))
        for k, (name, time_s, moved, colour) in enumerate(curves):
            shown = time_s <= SHOWN_S
            style = {"color": colour, "linestyle": DASHES[k], "linewidth": 1.1}
            canvas.line(i, name, time_s[shown] * 1e3, moved[shown] * 1e3, **style)
        canvas.axes[i].set_ylim(0.95, 1.05)
    canvas.legend_outside()
    return canvas
