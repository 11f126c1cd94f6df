"""How every strategy settles after a fast move, by direction and by target."""

from __future__ import annotations

import numpy as np

from analysis.measurements.settling import BAND_RAD, settling
from analysis.pages.explorer import Array, Explorer, Facts, Panel, Series, View
from analysis.paper.measured import Measured
from analysis.recorded.chop import ChopPhase
from analysis.report.strategies import STRATEGY_NAMES

SHOWN_S = 0.1
FIRST_RANGE_URAD = (-40.0, 40.0)
AXES = {0.0: "θx", 90.0: "θy"}


def settling_moves(measured: Measured) -> Explorer | None:
    """Return the error of the mean move over time; None where the campaign holds no fast chop."""
    alphas = sorted({float(s["alpha_deg"]) for s in measured.settings("settling")})
    views: dict[tuple[str, ...], View] = {}
    for alpha in alphas:
        strategies = {str(s["strategy"]): None for s in measured.settings("settling") if s["alpha_deg"] == alpha}
        phases = {name: phase for name in strategies if (phase := measured.settle(name, alpha)) is not None}
        for position, target in ((2, "away"), (1, "back")):
            if phases:
                views[direction(alpha), target] = _view(phases, alpha, position)
    if not views:
        return None
    return Explorer(
        "settling",
        "Settling of a fast chop",
        "Error along the direction of motion of the mean move, all cycles but the first; time from the start of the "
        "move. “away” is the move to the second position, “back” the one that returns. Shaded: ±1.7 µrad; a dash: "
        "never, not before the next move.",
        {"direction": tuple(dict.fromkeys(v[0] for v in views)), "move": tuple(dict.fromkeys(v[1] for v in views))},
        views,
    )


def direction(alpha_deg: float) -> str:
    """Return the direction of a chop as a reader names it."""
    return f"{AXES[alpha_deg]} (α = {alpha_deg:g}°)" if alpha_deg in AXES else f"α = {alpha_deg:g}°"


def along(phase: ChopPhase, alpha_deg: float, position: int) -> Array:
    """Return the error (dwell,), rad, of the mean move to `position` (1 or 2), along the direction of motion."""
    commanded = phase.commanded_rad[position - 1]
    error = np.stack([phase.moves(position, dof) - commanded[i] for i, dof in enumerate(("theta_x", "theta_y"))])
    alpha = np.deg2rad(alpha_deg)
    return np.asarray(np.array([np.cos(alpha), np.sin(alpha)]) @ error)


def _view(phases: dict[str, ChopPhase], alpha: float, position: int) -> View:
    series, rows = [], []
    for strategy, phase in phases.items():
        name = STRATEGY_NAMES.get(strategy, strategy)
        error = along(phase, alpha, position)
        settled = settling(error, phase.rate_hz, 0.0)
        time_s = np.arange(error.size) / phase.rate_hz
        shown = time_s <= SHOWN_S
        series.append(Series.of(name, time_s[shown] * 1e3, error[shown] * 1e6))
        rows.append((name, (float(settled.time_s[0]) * 1e3, float(settled.overshoot[0]) * 1e6)))
    band = (-BAND_RAD * 1e6, BAND_RAD * 1e6, "±1.7 µrad")
    panel = Panel("time (ms)", "error (µrad)", tuple(series), band=band, y_range=FIRST_RANGE_URAD)
    return View((panel,), Facts(("strategy", "settled after (ms)", "overshoot (µrad)"), tuple(rows)))
