"""Effects in words: files, options and JSON have slugs, sentences an engineer's words."""

from __future__ import annotations

import re

from sim_backend.effects.base import Effect

_SLUG = re.compile(r"[a-z0-9]+(?:-[a-z0-9]+)+")
_PLACED = re.compile(rf"(?<![\w./-])({_SLUG.pattern})(?= at )")

_WRITTEN = {
    "bouc-wen": "Bouc–Wen hysteresis",
    "coulomb-friction": "Coulomb friction",
    "cross-coupling": "cross-coupling",
    "end-stop-contact": "end-stop contact",
    "jiles-atherton": "Jiles–Atherton hysteresis",
    "position-dependent-force-constant": "position-dependent force constant",
}
"""The words of slugs for which replacing hyphens by spaces is not enough."""


def effect_text(name: str) -> str:
    """Return an effect in words: cubic stiffness for `cubic-stiffness`; any other text stays."""
    if name in _WRITTEN:
        return _WRITTEN[name]
    return name.replace("-", " ") if _SLUG.fullmatch(name) else name


def placed_text(effect: Effect | type[Effect], where: str) -> str:
    """Return the cause that an effect is reported as, in words, and its location."""
    return f"{effect_text(effect.reported())} at {where}"


def with_effects(text: str) -> str:
    """Return `text` with effects that stand before their location, as in the keys of tables, in words."""
    return _PLACED.sub(lambda found: effect_text(found[1]), text)
