"""How much of what its effects explain a fit may get wrong because nature's form of them is another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.fitting.balance import squares_of
from analysis.diagnosis.fitting.coherence import following_of
from analysis.diagnosis.fitting.fit import Fit, Setting, linear_of, residuals_of, simulated
from analysis.diagnosis.nominal.tuning import turned
from sim_backend.effects.base import Effect

Array = NDArray[np.float64]

_LAW, _EXACT, _STEADY = 3e-3, 1e-4, 1e-6
"""Parts of what an effect explains that may be the difference between our form of it and nature's, or what a simulation
in steps cannot do better: what explains less than that beside it is not looked for. A gain or a delay has no other form
(`exact`), but holds to 1 % only. What is linear in any form (`linear_form`) is wrong by what follows the drive by a
linear law: its distortion is that of an amplifier or of a spring, a thousandth."""


@dataclass(frozen=True)
class Leeway:
    """What may be wrong, as a sum of squares in units of the noise, in each of the readings at `outputs`.

    What an effect explains in one reading says nothing of how well another is understood. So much of `parts` as
    `linear` says is a wrong form of linear effects.
    """

    outputs: tuple[str, ...]
    parts: tuple[float, ...]
    linear: tuple[float, ...] = ()

    @property
    def total(self) -> float:
        """In all readings together."""
        return sum(self.parts)

    def of(self, shares: Sequence[float] | Array) -> float:
        """Return it for what shows in the readings by these `shares` of its energy; in total for what has none.

        No more than that of a wrong form lies along a signature: in each reading the part that the signature has there.
        """
        if len(shares) != len(self.parts) or not np.sum(shares) > 0.0:
            return self.total
        return float(np.dot(self.parts, shares))

    def along(self, following: Sequence[float] | Array) -> Leeway:
        """Return it for what follows the drive by a linear law in these parts of its energy, one for each reading."""
        if not any(self.linear):
            return self
        rest = np.array(self.parts) - np.array(self.linear) * (1.0 - np.asarray(following))
        return Leeway(self.outputs, tuple(rest.tolist()))

    def at(self, where: str) -> float:
        """Return it in the reading of a place, in all of them where the place has none of its own."""
        target = target_of(where)
        return self.parts[self.outputs.index(target)] if target in self.outputs else self.total


def target_of(where: str) -> str:
    """Return the degree of freedom at which what acts at `where` is seen."""
    return where.rpartition("->")[2]


def form_error(effect: Effect, following: float = 1.0) -> float:
    """Return the part of what an effect explains that its form may be wrong by.

    Along what follows the drive by a linear law in so large a part of its energy.
    """
    own = _EXACT if effect.exact else _LAW
    return _STEADY + (own - _STEADY) * following if effect.linear_form else own


def explained_by(setting: Setting, tuned: Fit, best: Fit) -> float:
    """Return by how much `best` lowers the sum of squares that `tuned` leaves, in units of the present noise."""
    if not best.candidates:
        return 0.0
    return max(float(np.sum(squares_of(setting, tuned.residuals))) - best.misfit, 0.0)


def beyond_form(setting: Setting, before: Fit, after: Fit, least: Leeway) -> bool:
    """Tell whether `after` explains more beside `before` than `least` allows the form of the effects there.

    Where these are linear, by what of the difference follows the drive by a linear law.
    """
    change = _change(before, after)
    parts = following_of(setting, linear_of(setting, before), change)
    gained = float(np.sum(squares_of(setting, before.residuals))) + before.penalty - after.objective
    moved = squares_of(setting, change)
    return gained >= least.along(parts).of(moved / max(float(np.sum(moved)), np.finfo(float).tiny))


def following(setting: Setting, before: Fit, after: Fit, place: str) -> float:
    """Return the part of what `after` changes in the reading of a place that follows the drive by a linear law.

    The largest in any reading where the place has none of its own.
    """
    parts = following_of(setting, linear_of(setting, before), _change(before, after))
    outputs = setting.places.outputs
    return float(parts[outputs.index(place)] if place in outputs else np.max(parts))


def _change(before: Fit, after: Fit) -> list[Array]:
    return [a - b for a, b in zip(before.residuals, after.residuals, strict=True)]


def leeway_of(setting: Setting, tuned: Fit, best: Fit) -> Leeway:
    """Return how much of what `best` explains its effects' forms may be wrong by."""
    outputs = setting.places.outputs
    if not best.candidates:
        return Leeway(tuple(outputs), (0.0,) * len(outputs))
    left = squares_of(setting, best.residuals)
    explained = np.maximum(squares_of(setting, tuned.residuals) - left, 0.0)

    @cache  # often two of these sets are one, and each is a simulation of all records
    def beside(kept: tuple[Effect, ...]) -> Array:
        """Return what the other effects explain beside those that are `kept`."""
        if not kept or len(kept) == len(best.effects):
            return np.zeros_like(explained) if kept else explained
        moved = simulated(setting, turned(setting.nominal, setting.knobs, best.change), kept)
        return np.clip(squares_of(setting, residuals_of(setting.data.records, moved)) - left, 0.0, explained)

    by_law = beside(tuple(e for e in best.effects if e.exact))
    bent = beside(tuple(e for e in best.effects if e.linear_form))
    neither = beside(tuple(e for e in best.effects if e.exact or e.linear_form))
    by_bent_law = np.minimum(neither, np.minimum(by_law, bent))
    parts = _LAW * by_law + _EXACT * (explained - by_law)
    # what is linear, by a law and exactly
    lawful, exactly = by_law - by_bent_law, np.maximum((explained - by_law) - (bent - by_bent_law), 0.0)
    linear = (_LAW - _STEADY) * lawful + (_EXACT - _STEADY) * exactly
    return Leeway(tuple(outputs), tuple(parts.tolist()), tuple(linear.tolist()))
