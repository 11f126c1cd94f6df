"""How much of what its effects explain a fit may get wrong because nature's form of them is another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.fitting.balance import squares_of
from analysis.diagnosis.fitting.fit import Fit, Setting, residuals_of, simulated
from analysis.diagnosis.nominal.tuning import turned
from sim_backend.effects.base import Effect

Array = NDArray[np.float64]

_LAW, _EXACT = 3e-3, 1e-4
"""Parts of what an effect explains that may be the difference between our form of it and nature's, or what a simulation
in steps cannot do better: what explains less than that beside it is not looked for. A gain or a delay has no other form
(`exact`), but is only so linear and so steady: to 1 %."""


@dataclass(frozen=True)
class Leeway:
    """What may be wrong, as a sum of squares in units of the noise, in each of the readings at `outputs`.

    What an effect explains in one reading says nothing of how well another is understood.
    """

    outputs: tuple[str, ...]
    parts: tuple[float, ...]

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

    def at(self, where: str) -> float:
        """Return it in the reading of a place, in all of them where the place has none of its own."""
        target = target_of(where)
        return self.parts[self.outputs.index(target)] if target in self.outputs else self.total


def target_of(where: str) -> str:
    """Return the degree of freedom at which what acts at `where` is seen."""
    return where.rpartition("->")[2]


def form_error(effect: Effect) -> float:
    """Return the part of what an effect explains that its form may be wrong by."""
    return _EXACT if effect.exact else _LAW


def explained_by(setting: Setting, tuned: Fit, best: Fit) -> float:
    """Return by how much `best` lowers the sum of squares that `tuned` leaves, in units of the present noise."""
    if not best.candidates:
        return 0.0
    return max(float(np.sum(squares_of(setting, tuned.residuals))) - best.misfit, 0.0)


def leeway_of(setting: Setting, tuned: Fit, best: Fit) -> Leeway:
    """Return how much of what `best` explains its effects' forms may be wrong by."""
    outputs = setting.places.outputs
    if not best.candidates:
        return Leeway(tuple(outputs), (0.0,) * len(outputs))
    left = squares_of(setting, best.residuals)
    explained = np.maximum(squares_of(setting, tuned.residuals) - left, 0.0)
    exact = [e for e in best.effects if e.exact]
    by_law = explained if len(exact) < len(best.effects) else np.zeros_like(explained)
    if exact and len(exact) < len(best.effects):
        moved = simulated(setting, turned(setting.nominal, setting.knobs, best.change), exact)
        without = squares_of(setting, residuals_of(setting.data.records, moved))
        by_law = np.clip(without - left, 0.0, explained)
    return Leeway(tuple(outputs), tuple((_LAW * by_law + _EXACT * (explained - by_law)).tolist()))
