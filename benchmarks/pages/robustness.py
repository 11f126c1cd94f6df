"""The table of robustness in docs/control.md, from what `python -m benchmarks.robustness` writes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from analysis.recorded.requirements import POWER_W
from benchmarks.pages.marks import link, percent
from benchmarks.robustness_trial import STEP_S, STRAY_RAD, UNSAFE_CYCLES


def table(files: Sequence[Path]) -> str:
    """Return a row for every file and controller as Markdown; raises ValueError without a file."""
    if not files:
        raise ValueError("the table of robustness needs at least one results file; name it in the BEGIN mark")
    heads = ("benches", "controller", "all requirements met (95 %)", "safe", "θx, θy settle within", "stability, 3σ")
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for file in files:
        found = json.loads(file.read_text(encoding="utf-8"))
        drawn = link(file, _drawn(found["spread"]))
        for name, s in found["strategies"].items():
            lines.append(_line(drawn, name, s))
            drawn = ""
    below = (
        f"*Safe*: never more than {UNSAFE_CYCLES} cycles in a row in which an axis is {1e6 * STRAY_RAD:.0f} µrad off "
        f"later than {1e3 * STEP_S:.0f} ms after its step began, or the power exceeds {POWER_W:g} W.\n"
        "The last two columns are the worst values, of chops that were not stopped and that settled."
    )
    return "\n".join([*lines, "", below]) + "\n"


def _drawn(spread: Any) -> str:
    if "far" in spread:
        return f"modes within {100.0 * spread['far']:g} %"
    return f"modes ± {100.0 * spread['frequency']:g} %"


def _line(drawn: str, name: str, s: dict[str, Any]) -> str:
    low, high = (percent(max(end, 0.0)) for end in s["ci95"])
    met = f"{s['met']} of {s['of']} ({low}–{high} %)"
    times = ", ".join(_ms(s["worst"].get(f"settling {axis}")) for axis in ("theta_x", "theta_y"))
    stability = f"{1e6 * s['worst']['stability']:.3g} µrad"
    return f"| {drawn} | {name} | {met} | {s.get('safe', '–')} | {times} ms | {stability} |"


def _ms(seconds: float | None) -> str:
    return "never" if seconds is None else f"{1e3 * seconds:.1f}"
