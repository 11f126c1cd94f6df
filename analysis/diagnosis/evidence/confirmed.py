"""An effect found beside another has to be significant on all samples, the held-out ones among them.

A large right cause gains so much on held-out samples that a small wrong one beside it is not seen in the total. It is
seen in comparison with the fit without it: it is overfitted to slow noise, or to the residual of a start, of the fitted
samples. Its misfit on the others is subtracted from the evidence that it has from these.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from analysis.diagnosis.evidence.gain import errors_in_noise, size_on_held_out
from analysis.diagnosis.evidence.tuning_errors import tuning_errors
from analysis.diagnosis.fitting.balance import again, iterated_gls, score
from analysis.diagnosis.fitting.discrepancy import discrepancy_of, explained_by
from analysis.diagnosis.fitting.fit import Fit, linear_of, residuals_on
from analysis.diagnosis.noise.estimate import whitener_from
from analysis.diagnosis.records.dataset import Dataset
from analysis.diagnosis.search.pruning import alone, lead_of
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.verdict.held_out import surely_misses


def confirmed(found: Found, data: Dataset) -> Found:
    """Return `found` without the effects that are not worth their price on all samples of `data`, the worst first.

    The last one stays: whether it may be named depends on the gain as a whole.
    """
    if found.setting.whitener.even or not any(w.held_out for _, w in data.windows):
        return found
    while len(found.best.candidates) > 1 and (worst := _worst(found, data)) is not None:
        gone, rest, setting = worst.candidate, worst.rest, found.setting
        rivals = tuple(r for r in found.rivals if gone not in _keys(r))
        explained, form = explained_by(setting, found.tuned, rest), discrepancy_of(setting, found.tuned, rest)
        found = replace(found, best=rest, rivals=rivals, explained=explained, discrepancy=form, unlisted_leads=())
    return found


@dataclass(frozen=True)
class _Worst:
    """An effect that is not worth its price, by name and location, the fit without it, and its evidence."""

    candidate: tuple[str, str]
    rest: Fit
    worth: float


def _worst(found: Found, data: Dataset) -> _Worst | None:
    """Return the effect that all samples contradict most; None where each is worth its price and fits well enough."""
    setting, best, known = found.setting, found.best, found.setting.whitener.repeats
    after = residuals_on(data, setting, best)
    noise = setting.whitener if known and not setting.added else whitener_from(data, list(after))
    last = linear_of(setting, best)
    errors = errors_in_noise(data, tuning_errors(data, setting, best), noise, last)
    worst: _Worst | None = None
    for i, candidate in enumerate(best.candidates):
        rest = _without(found, i)
        before = residuals_on(data, setting, rest)
        times, std = size_on_held_out(data, before, after, noise, linear_of(setting, rest), last, errors)
        # the squares that it takes away there, in units of the noise: (2 t - 1) / σ²
        worth = lead_of(setting, best, rest) + (2.0 * times - 1.0) / std**2
        wrong = worth < found.first.price or surely_misses(times, std)
        if wrong and (worst is None or worth < worst.worth):
            worst = _Worst(candidate.key, rest, worth)
    return worst


def _without(found: Found, i: int) -> Fit:
    """Return the best fit without effect `i`, all other parameters adjusted."""
    setting, best, known = found.setting, found.best, found.setting.whitener.repeats
    keep = [k for k in range(len(best.candidates)) if k != i]
    wanted = sorted(best.candidates[k].key for k in keep)
    fits = [r for r in found.rivals if _keys(r) == wanted]
    if not fits:
        rest = alone(setting, best, again(setting, found.tuned), keep)
        fits = [rest if known else iterated_gls(setting, rest)[1]]
    return min(fits, key=lambda r: score(r, known))


def _keys(fit: Fit) -> list[tuple[str, str]]:
    return sorted(c.key for c in fit.candidates)
