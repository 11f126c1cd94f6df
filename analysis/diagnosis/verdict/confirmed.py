"""What was found beside something else has to be found on held-out rows as well: each effect by itself.

A large right cause gains so much on held-out rows that a small wrong one beside it is not seen in the whole. Held
against the fit without it, the wrong one is: it bent itself to slow noise, or to what a start had left, of the fitted
rows, and misses more of the others than it explains.
"""

from __future__ import annotations

from dataclasses import replace

from analysis.diagnosis.evidence.gain import size_on_held_out
from analysis.diagnosis.fitting.balance import score
from analysis.diagnosis.fitting.discrepancy import discrepancy_of, explained_by
from analysis.diagnosis.fitting.fit import Fit, linear_of, residuals_on
from analysis.diagnosis.noise.estimate import whitener_from
from analysis.diagnosis.records.dataset import Dataset
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.verdict.held_out import disproved


def confirmed(found: Found, data: Dataset) -> Found:
    """Return `found` without the effects that held-out rows of `data` disprove, the worst first.

    The last one stays: whether it may be named is asked of the gain as a whole.
    """
    if found.setting.whitener.even or not any(w.held_out for _, w in data.windows):
        return found
    while len(found.best.candidates) > 1:
        rest = _without_disproved(found, data)
        if rest is None:
            break
        setting, tuned = found.setting, found.tuned
        explained, form = explained_by(setting, tuned, rest), discrepancy_of(setting, tuned, rest)
        found = replace(found, best=rest, rivals=(*found.rivals, found.best), explained=explained, discrepancy=form)
    return found


def _without_disproved(found: Found, data: Dataset) -> Fit | None:
    """Return the best fit without the effect that held-out rows disprove most clearly; None if they disprove none."""
    setting, best, known = found.setting, found.best, found.setting.whitener.repeats
    after = residuals_on(data, setting, best)
    noise = setting.whitener if known and not setting.added else whitener_from(data, list(after))
    worst: tuple[float, Fit] | None = None
    for candidate in best.candidates:
        others = {c.key for c in best.candidates} - {candidate.key}
        without = [r for r in found.rivals if {c.key for c in r.candidates} == others]
        if not without:
            continue
        rest = min(without, key=lambda r: score(r, known))
        before = residuals_on(data, setting, rest)
        times, std = size_on_held_out(data, before, after, noise, linear_of(setting, rest), linear_of(setting, best))
        if disproved(times, std) and (worst is None or times < worst[0]):
            worst = times, rest
    return None if worst is None else worst[1]
