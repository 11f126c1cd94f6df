"""A cause that was found with every row counting alike, told as exactly as the noise allows.

Where the error of a model is many times the noise, all rows are weighed alike (see `analysis.diagnosis.gross`). Once a
cause is found that leaves no more than noise, that no longer serves: a standard deviation in units of what the model
missed is a hundred times too wide, and a second cause that is small beside the first goes unseen.
"""

from __future__ import annotations

from dataclasses import replace

from analysis.diagnosis.candidates.signature import Scales
from analysis.diagnosis.fitting.balance import again, settle, tune
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.fitting.refit import refit
from analysis.diagnosis.result import ABOVE_NOISE
from analysis.diagnosis.search.rounds import Found, Progress, search
from analysis.diagnosis.search.shortlist import Rules

_RIVALS = 3
"""Other kinds of cause that are held against the first in the noise as well, those that came nearest."""


def found_in_noise(setting: Setting, found: Found, rules: Rules, scales: Scales, progress: Progress) -> Found:
    """Return the search gone on with from the best of `found`, under the noise of `setting`, where little more is left.

    As it is where the best still leaves more than so many times the noise: then noise is no measure of anything.
    """
    setting, tuned = tune(setting)
    best = _fitted(setting, found.best)
    for _ in range(2):  # the swing from rest is noise until the model explains it
        setting = settle(setting, best)
        best = again(setting, best)
    other = search(setting, tuned, rules, scales, progress, best)
    if other.best.misfit > ABOVE_NOISE**2 * other.best.rows:
        return found
    rivals = [_fitted(other.setting, fit) for fit in _others(found)]
    return replace(other, rivals=(*other.rivals, *rivals))


def _fitted(setting: Setting, fit: Fit) -> Fit:
    """Return a fit of other data or another noise, fitted to those of `setting`."""
    candidates, sizes = fit.held()
    return refit(setting, candidates, sizes, fit.change, exact=True)


def _others(found: Found) -> list[Fit]:
    """Return the best fit of each other kind of cause, nearest first."""
    own, others = found.best.effects[0].reported(), dict[str, Fit]()
    for rival in sorted((r for r in found.rivals if r.effects), key=lambda r: r.misfit):
        others.setdefault(rival.effects[0].reported(), rival)
    return [fit for name, fit in others.items() if name != own][:_RIVALS]
