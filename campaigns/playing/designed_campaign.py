"""The campaigns around a controller: what it is designed from, and what judges it (Tables 6.6 and 6.7)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from campaigns.playing.campaign import Campaign, RunEntry

AXES = {"x": 0.0, "y": 90.0}
"""Axes by the last letter of their name, and the direction of a chop that moves them alone, in degrees."""

ALPHAS_DEG = (0, 120, 240)
FORMS_RAD = {"up": (0.0, 8.5e-3), "down": (0.0, -8.5e-3), "wide": (-8.5e-3, 8.5e-3)}
"""Directions and end points of Table 6.7."""

SLOW_LEARNING_S = 8.0
"""Learning of a slow chop, four of its periods: it is observed long after the feedback has settled."""

KNOWING = ("designed", "designed-hysteresis", "designed-modes", "designed-linear")


def measuring_campaign(axes: Sequence[str]) -> Campaign:
    """Return the runs that a controller of these tilt axes is designed from: sweeps, the bench at rest, its loops."""
    runs = [RunEntry(name=f"sweep-{axis}", plan="sinesweep", settings={"axis": axis}) for axis in axes]
    runs.append(RunEntry(name="rest", plan="rest"))
    runs += [RunEntry(name=f"hysteresis-{axis}", plan="hysteresis", settings={"axis": axis}) for axis in axes]
    return Campaign(name="measuring", title="what a controller is designed from", runs=tuple(runs))


def designed_campaign(controller: Path, levels: Mapping[str, float] | None = None) -> Campaign:
    """Return the runs that play the controller in a file: slow chops, fast ones by knowledge, and the long one.

    `levels` of the disturbance go by the names of the paper's runs: a slow chop has that of the same chop there.
    """
    shaken = levels or {}
    runs = [
        _run(f"{strategy}-settle-{axis}", "settling", controller, strategy, alpha_deg=alpha)
        for strategy in KNOWING
        for axis, alpha in AXES.items()
    ]
    runs += [
        _run(
            f"designed-chop-{alpha}-{form}",
            "chop",
            controller,
            alpha_deg=float(alpha),
            from_rad=start,
            to_rad=stop,
            tuning={"learning_s": SLOW_LEARNING_S},
            disturbance=shaken.get(f"chop-{alpha}-{form}", 1.0),
        )
        for alpha in ALPHAS_DEG
        for form, (start, stop) in FORMS_RAD.items()
    ]
    runs.append(_run("designed-thermal", "thermal", controller))
    return Campaign(name="designed", title="this project's controller", runs=tuple(runs))


def _run(
    name: str, plan: str, controller: Path, strategy: str = "designed", disturbance: float = 1.0, **settings: Any
) -> RunEntry:
    played = {"strategy": strategy, "controller": str(controller), **settings}
    return RunEntry(name=name, plan=plan, settings=played, disturbance=disturbance)
