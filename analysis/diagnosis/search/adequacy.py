"""When a set of effects is adequate: its residual is noise, or next to nothing of what it was to explain."""

from __future__ import annotations

import numpy as np

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.search.gram import COLLINEAR
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.tails import normal_tail

EXPLAINED = 0.997
"""An extension is adequate without reaching the noise floor when it removes this part of the excess: a name that
leaves more is likely that of a confounder (an end stop absorbs 98.6 % of a cubic spring's effect, a hysteresis 99.1 %
of friction's)."""


LEAST_CHANCE = 1e-300
"""A smaller chance is stated as this one."""


def adequate(found: Found, allowed: float = 0.0) -> bool:
    """Tell whether the best model is adequate.

    Where periods repeat: its excess mean square over the noise, less `allowed` for causes that the search cannot see,
    is within the uncertainty of the noise, or the model explains at least `EXPLAINED` of the initial excess. Elsewhere:
    no further candidate would lower the squares by more than 1 − `EXPLAINED` of what the model explains.
    """
    best = found.best
    if not found.setting.whitener.repeats:
        out = standing_out(found)
        return out is None or out[0] <= (1.0 - EXPLAINED) * found.explained
    spread = uncertainty(found) + 0.002
    excess = best.misfit / best.rows - 1.0 - allowed
    return bool(excess <= spread or explained_part(found) >= EXPLAINED)


def standing_out(found: Found) -> tuple[float, float, Candidate] | None:
    """Return the significant candidate that lowers the squares most beside the best model, with drop and evidence."""
    last = found.last
    significant = np.flatnonzero((last.tolerance > COLLINEAR) & (last.gains > last.threshold))
    if not significant.size:
        return None
    i = int(significant[np.argmax(last.drops[significant])])
    return float(last.drops[i]), float(last.gains[i]), last.candidates[i]


def explained_part(found: Found) -> float:
    """Return the part of what was more than noise that the best model explains, all where nothing was."""
    best, excess = found.best, found.tuned.misfit - found.tuned.rows
    return 1.0 - (best.misfit - best.rows) / excess if excess > 0.0 else 1.0


def chance_of(found: Found, excess: float) -> float:
    """Return the chance that noise alone leaves so much more than its own level, a mean square of one; never zero."""
    return max(normal_tail(4.0 * excess / uncertainty(found)), LEAST_CHANCE)


def uncertainty(found: Found) -> float:
    """Return by how much noise alone may miss its own level, a mean square of one: four standard deviations.

    Both have finite degrees of freedom: the residual those of all samples, the level those of differences of periods.
    """
    data = found.setting.data
    seen = max(data.n_outputs * data.noise_rows, 1)
    return float(4.0 * np.sqrt(2.0 / found.tuned.rows + 2.0 / seen))
