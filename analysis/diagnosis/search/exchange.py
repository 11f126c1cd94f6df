"""A first cause is found alone, and may be a confounder of another: beside the later ones it is searched for again.

Of two effects of one size a flexible one explains most by itself: a hysteresis loop that stiffens, where a lag and a
cubic spring act. The second effect is still found beside it, and beside the second the search finds the effect that the
first replaced. The same holds for two variants of one cause, of which the more flexible one is first found alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from analysis.diagnosis.candidates.signature import Scales
from analysis.diagnosis.fitting.balance import again, iterated_gls, score
from analysis.diagnosis.search.pruning import alone
from analysis.diagnosis.search.rounds import Found, search
from analysis.diagnosis.search.shortlist import SURE_LEAD, Rules
from analysis.diagnosis.search.stage import Progress, silent
from sim_backend.effects.words import effect_text

_MOST = 3
"""Effects that are searched for again at most: more are mostly modes, which absorb any unlisted cause."""

_AT = 0.85
"""Share of the whole diagnosis that is done when this begins."""


def exchangeable(found: Found) -> bool:
    """Tell whether one of the effects of `found` may be a confounder of another that shows beside the rest alone."""
    return 2 <= len(found.best.candidates) <= _MOST


def exchanged(found: Found, doubtful: Sequence[int], rules: Rules, scales: Scales, progress: Progress) -> Found:
    """Return the best of `found` and of searches that begin without one of its `doubtful` effects, each in turn.

    One other effect is searched for instead, and more only beside one that is clearly better: most often there is
    none, and each search is as long as the first. The effects beside one that was replaced were found beside it:
    they are doubtful anew.
    """
    known = found.setting.whitener.repeats
    best = begun = found
    nominal, left, replaced = again(begun.setting, found.tuned), list(doubtful), 0
    while left:
        i, numbers = left.pop(0), range(len(begun.best.candidates))
        progress(f"looking again for what {effect_text(begun.best.effects[i].reported())} is", _AT)
        start = alone(begun.setting, begun.best, nominal, [k for k in numbers if k != i])
        other = search(begun.setting, found.tuned, rules, scales, silent, start, rounds=1)
        clearly = score(best.best, known) - score(other.best, known) > 2.0 * SURE_LEAD
        if clearly:
            other = search(other.setting, found.tuned, rules, scales, silent, other.best)
        # the first search has scored single effects by themselves already
        best = replace(_better(best, other), first=found.first, passed=found.passed)
        if clearly and replaced < _MOST and exchangeable(best):
            beside = {c.key for k, c in enumerate(begun.best.candidates) if k != i}
            begun, nominal, replaced = best, again(best.setting, found.tuned), replaced + 1
            left = [k for k, c in enumerate(begun.best.candidates) if c.key in beside]
    return best


def _better(one: Found, other: Found) -> Found:
    """Return the one of two that has more evidence, the best of the other among its rivals."""
    known = one.setting.whitener.repeats
    best, rest = (one, other) if score(one.best, known) <= score(other.best, known) else (other, one)
    setting = best.setting
    rival = again(setting, rest.best) if known else iterated_gls(setting, rest.best)[1]
    return replace(best, rivals=(*best.rivals, rival))
