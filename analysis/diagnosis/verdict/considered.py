"""Everything that a named or tied cause was compared with, the model as it is among it."""

from __future__ import annotations

from analysis.diagnosis.fitting.balance import score
from analysis.diagnosis.result import NOTHING_ADDED
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.verdict.judging import Judgement


def considered_of(found: Found, judgement: Judgement) -> tuple[tuple[str, float], ...]:
    """Return the rivals of a judgement and the hypothesis that nothing is added, the best first.

    Each has the natural logarithm of its evidence over that of the best. Without a cause nothing was compared; nor is
    a model without one where the error is not weighed by noise.
    """
    setting = found.setting
    if not judgement.rivals or setting.whitener.even:
        return judgement.rivals
    known = setting.whitener.repeats
    gap = 0.5 * (score(found.tuned, known) - score(found.best, known)) / judgement.inflation
    return tuple(sorted((*judgement.rivals, (NOTHING_ADDED, min(-gap, 0.0))), key=lambda one: -one[1]))
