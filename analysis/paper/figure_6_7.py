"""Fig. 6.7: hysteresis loops with the linear part taken out, and the fitted model."""

from __future__ import annotations

import numpy as np

from analysis.measurements.loop_fit import magnetisation
from analysis.pages.canvas import COLOURS, Canvas
from analysis.paper.measured import RATE_HZ, Measured
from analysis.recorded.loop_fit import HELD


def figure_6_7(measured: Measured) -> Canvas | None:
    """Return every recorded loop beside the nonlinear model run along a sine of the same amplitude."""
    loops, fit = measured.loops("theta_x"), measured.loop_fit("theta_x")
    if not loops or fit is None:
        return None
    canvas = Canvas(
        "Hysteresis in θx",
        "Angle without its linear part, averaged over one period of the suspension; dashed: the fitted Jiles–Atherton "
        "model and polynomial. The paper finds about 0.7 % of the angle at zero input.",
        columns=len(loops),
        size=(7.2, 3.4),
        share_y=True,
    )
    for i, (torque, found) in enumerate(loops.items()):
        canvas.panel(i, f"{torque:g} N m", "torque (N m)", "deviation (µrad)" if i == 0 else "")
        every = min(max(round(measured.suspension_period_s("theta_x") * RATE_HZ), 1), found.torque_nm.size // 50)
        mean = [
            a[: a.size // every * every].reshape(-1, every).mean(axis=1) for a in (found.torque_nm, found.deviation_rad)
        ]
        colour = COLOURS[i % len(COLOURS)]
        canvas.line(i, f"bench, {100 * found.remanence_ratio:.2f} %", mean[0], mean[1] * 1e6, color=colour)
        model_torque, model_angle = _model_loop(fit.parameters, found.amplitude_rad)
        slope = float(model_torque @ model_angle / (model_torque @ model_torque))
        deviation = (model_angle - model_angle.mean() - slope * model_torque) * 1e6
        canvas.line(i, "fitted model", model_torque, deviation, color="#1b1b1f", linestyle="--", linewidth=0.9)
    canvas.legend_outside()
    return canvas


def _model_loop(parameters: dict[str, float], amplitude_rad: float) -> tuple[np.ndarray, np.ndarray]:
    """Torque (without its mean) and angle of one steady cycle of the fitted model, the angle a slow sine."""
    n = 1000
    angle = amplitude_rad * np.sin(2.0 * np.pi * np.arange(3 * n) / n)
    loop = magnetisation(angle, {**HELD, "pinning": parameters["pinning"]})
    torque = parameters["stiffness"] * angle - parameters["size"] * loop
    for power in (2, 3, 4, 5):
        torque = torque - parameters[f"power_{power}"] * angle**power
    return torque[-n:] - torque[-n:].mean(), angle[-n:]
