"""Noise and fit settle together where records begin in a motion that fades while they last.

What a fit misses of that motion differs between periods, as noise does, so that each is known only as well as the
other. This is for the end of a search: a cause that a fit still lacks, noise would absorb.
"""

from __future__ import annotations

from analysis.diagnosis.fitting.balance import again, reestimated, score
from analysis.diagnosis.fitting.fit import Fit, Setting

_STEPS, _WORTH_A_STEP = 30, 1.0
"""Steps at most, and what one has to gain, in twice the logarithm of evidence."""

_NEAR_NOISE = 1.5
"""What a fit may leave at most, as a mean square in units of the noise: of one that misses more, steps do not end."""


def beside_what_fades(setting: Setting, best: Fit) -> tuple[Setting, Fit]:
    """Return `best` and the setting whose noise goes with it; as given where no motion fades or nothing is gained."""
    fades = best.candidates and any(record.fades for record in setting.data.records)
    for _ in range(_STEPS if fades else 0):
        if not best.misfit < _NEAR_NOISE * best.rows:
            break
        there = reestimated(setting, best)
        fit = again(there, best)
        if score(best, True) - score(fit, True) < _WORTH_A_STEP:
            break
        setting, best = there, fit
    return setting, best
