"""Effects and hypotheses in words: files and options have slugs, sentences and pages an engineer's words."""

from __future__ import annotations

import re
from functools import cache

from analysis.diagnosis.result import NOTHING_ADDED, Visible
from sim_backend.effects import named

_SLUG = re.compile(r"[a-z0-9]+(?:-[a-z0-9]+)+")

_WRITTEN = {
    "coulomb-friction": "Coulomb friction",
    "cross-coupling": "cross-coupling",
    "end-stop-contact": "end-stop contact",
    "position-dependent-force-constant": "position-dependent force constant",
}
"""Slugs whose words are not those between their hyphens."""


def effect_text(name: str) -> str:
    """Return an effect in words: cubic stiffness for `cubic-stiffness`; any other text stays."""
    if name in _WRITTEN:
        return _WRITTEN[name]
    return name.replace("-", " ") if _SLUG.fullmatch(name) else name


def hypothesis_text(name: str) -> str:
    """Return a hypothesis, slugs joined by +, in words."""
    return "nothing added" if name == NOTHING_ADDED else " and ".join(map(effect_text, name.split("+")))


@cache
def _measures() -> dict[tuple[str, str], str]:
    """Return what each parameter of each effect of the library is, in words."""
    return {(e.reported(), p.name): p.about for e in reversed(named()) for p in e.parameters()}


def measure_text(one: Visible) -> str:
    """Return in words what the size of an effect is measured by; the name of a parameter that the library has not."""
    about = _measures().get((one.effect, one.parameter), one.parameter.replace("_", " "))
    return re.sub(r" at `reach`$", "", about)
