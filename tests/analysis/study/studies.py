"""Small studies for the tests: fast chops of the bench as built, and the smallest trial of every kind."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from analysis.study.definition import SCHEMA, Study, parse_study

SPREAD = """
schema = "mccd-study/1"
name = "spread"
kind = "settling"
trials = {trials}
seed = 3
[settings]
cycles = 2
alpha_deg = 90.0
[[vary]]
place = "model.modes[theta_y suspension].frequency_hz"
relative = true
normal = {{ std = 0.01 }}
[[vary]]
place = "settings.strategy"
sweep = ["hybrid", "mbff"]
"""

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
SHORT = {"axes": ["theta_x"], "torque_rms_nm": 0.01, "stop_hz": 200.0, "period_s": 0.5, "realisations": 1}
HIDDEN = {"effect": "cubic-stiffness", "where": "theta_x", "parameters": {"stiffness": 300.0}}
SMALLEST: dict[str, dict[str, Any]] = {
    "settling": {"cycles": 2},
    "chop": {"cycles": 1, "frequency_hz": 2.0, "window_s": 0.1},
    "diagnosis": {"hidden": HIDDEN, "plan_settings": SHORT},
    "endstops": {"ramp_s": 0.1, "settle_s": 0.3, "hold_s": 0.1},
    "hysteresis": {"torques_nm": [0.05, 0.02], "frequency_hz": 2.0},
    "theodolite": {"x_rad": [-4e-3, 0.0, 4e-3], "y_rad": [-4e-3, 4e-3], "settle_s": 0.1, "hold_s": 0.05},
    "thermal": {"cycles": 5},
}
"""Settings of the smallest trial of every kind that comes to a result."""

RESULTS = ("trials.csv", "study.json", "study.svg")


def spread(trials: int = 5, more: str = "") -> Study:
    """Return a study of a fast chop over one frequency and two strategies."""
    return parse_study(SPREAD.format(trials=trials) + more, "study")


def smallest(kind: str, trials: int) -> Study:
    """Return a study of the smallest trials of a kind, over the frequency of one mode."""
    content = {
        "schema": SCHEMA,
        "name": f"smallest-{kind}",
        "kind": kind,
        "trials": trials,
        "model": str(EXAMPLES / "quiet.toml") if kind == "diagnosis" else "as-built",
        "settings": SMALLEST[kind],
        "vary": [{"place": "model.modes[*suspension].frequency_hz", "relative": True, "normal": {"std": 0.01}}],
    }
    return msgspec.convert(content, Study)


def results(folder: Path) -> dict[str, bytes]:
    """Return the bytes of every file that must not depend on how the trials were done."""
    return {name: (folder / name).read_bytes() for name in RESULTS}
