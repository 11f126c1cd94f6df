"""How much of what its effects explain a fit may get wrong because nature's form of them is another."""

from __future__ import annotations

from analysis.diagnosis.fit import Fit, Setting, residuals_of, simulated
from analysis.diagnosis.settling import square_of
from analysis.diagnosis.tuning import turned
from sim_backend.effects.base import Effect

_LAW, _EXACT = 3e-3, 1e-4
"""Parts of what an effect explains that may be the difference between our form of it and nature's, or what a simulation
in steps cannot do better: what explains less than that beside it is not looked for. A gain or a delay has no other form
(`exact`), but is only so linear and so steady: to 1 %."""


def form_error(effect: Effect) -> float:
    """Return the part of what an effect explains that its form may be wrong by."""
    return _EXACT if effect.exact else _LAW


def explained_by(setting: Setting, tuned: Fit, best: Fit) -> float:
    """Return by how much `best` lowers the sum of squares that `tuned` leaves, in units of the present noise."""
    if not best.candidates:
        return 0.0
    return max(square_of(setting, tuned.residuals) - best.misfit, 0.0)


def leeway_of(setting: Setting, tuned: Fit, best: Fit) -> float:
    """Return how much of what `best` explains its effects' forms may be wrong by, in units of the noise."""
    explained = explained_by(setting, tuned, best)
    exact = [e for e in best.effects if e.exact]
    if len(exact) == len(best.effects):
        return _EXACT * explained
    if not exact:
        return _LAW * explained
    moved = simulated(setting, turned(setting.nominal, setting.knobs, best.change), exact)
    by_law = min(max(square_of(setting, residuals_of(setting.data.records, moved)) - best.misfit, 0.0), explained)
    return _LAW * by_law + _EXACT * (explained - by_law)
