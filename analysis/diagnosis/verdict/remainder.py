"""The lack of fit of the best model: how much of the residual is not noise, where it is, and how sure that is.

A listed effect is a law; the bench's own is never quite that law. So a name is a claim about a part of the error. The
lack of fit is stated beside the name and does not withdraw it, as long as no generic alternative does as well.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.diagnosis.result import Remainder
from analysis.diagnosis.search.adequacy import LEAST_CHANCE, adequate, chance_of, standing_out
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.tails import chi2_tail
from analysis.diagnosis.verdict.lack_of_fit import ONE_IN_A_MILLION, LackOfFit
from sim_backend.effects.words import placed_text

_STATED = 1e-3
"""Chance below which a basis function may be stated as the location of a residual that is too large."""


def telling(found: Found, left: Sequence[LackOfFit], random: float = 0.0) -> LackOfFit | None:
    """Return the residual above noise along a basis function; None where there is none.

    The model discrepancy of the effects found is subtracted, and what `random` causes have in a few columns.
    """
    for one in left:
        if one.p_value(random + found.discrepancy.of(one.shares)) < ONE_IN_A_MILLION:
            return one
    return None


def remainder_of(
    found: Found, left: Sequence[LackOfFit], allowed: float = 0.0, random: float = 0.0
) -> Remainder | None:
    """Return the lack of fit of the best model; None where all is noise or within the model discrepancy of its effects.

    `allowed` is the mean square and `random` twice the log-likelihood along a few columns that causes may have which no
    search can see; `left` is the residual along basis functions, least likely first.
    """
    one, enough = telling(found, left, random), adequate(found, allowed)
    if one is None and enough:
        return None
    excess, chance, lives = _in_all(found, allowed)
    if one is not None:
        excess, chance, lives = max(excess, one.drop), min(chance, one.p_value(random)), f"{one.what} at {one.where}"
    elif left and not lives:
        lives = f"{left[0].what} at {left[0].where}" if left[0].p_value(random) < _STATED else "nothing simple"
    share = float(np.clip(excess / _whole(found, allowed, excess), 0.0, 1.0))
    return Remainder(share, max(chance, LEAST_CHANCE), lives)


def _whole(found: Found, allowed: float, excess: float) -> float:
    """Return the squared error that was more than noise, in units of the noise."""
    if found.setting.whitener.repeats:
        return max(found.tuned.misfit - found.tuned.rows * (1.0 + allowed), excess, 1.0)
    return max(found.explained + excess, 1.0)


def _in_all(found: Found, allowed: float) -> tuple[float, float, str]:
    """Return the squared error left above noise, the chance of as much, and what it looks like where that is known."""
    best = found.best
    if found.setting.whitener.repeats:
        excess = best.misfit / best.rows - 1.0 - allowed
        return max(excess, 0.0) * best.rows, chance_of(found, excess), ""
    out = standing_out(found)
    if out is None:
        return 0.0, 1.0, ""
    drop, gain, candidate = out
    chance = float(chi2_tail(gain, max(len(candidate.unit_sizes), 1)))
    return drop, chance, f"resembles {placed_text(candidate.effect, candidate.where)}"
