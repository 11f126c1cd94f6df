"""What measures an effect, in words."""

from __future__ import annotations

from functools import cache

from analysis.diagnosis.result import Visible
from sim_backend.effects import named


@cache
def _measures() -> dict[tuple[str, str], str]:
    """Return what each parameter of each effect of the library is, in words."""
    return {(e.reported(), p.name): p.about for e in reversed(named()) for p in e.parameters()}


def measure_text(one: Visible) -> str:
    """Return in words what the size of an effect is measured by; the name of a parameter that the library has not."""
    return _measures().get((one.effect, one.parameter), one.parameter.replace("_", " "))
