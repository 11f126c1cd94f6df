"""One round of a search: significant or promising candidates beside a fit, each fitted from its screened size."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.fitting.balance import iterated_gls, score, squares_of
from analysis.diagnosis.fitting.discrepancy import Discrepancy, beyond_form
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.nominal.tuning import mahalanobis2_of
from analysis.diagnosis.search.extension import extended
from analysis.diagnosis.search.shortlist import Screen, promising, shortlist
from analysis.diagnosis.side_by_side import side_by_side
from sim_backend.effects.base import Effect
from sim_backend.effects.words import effect_text

Progress = Callable[[str, float], None]


def silent(what: str, part: float) -> None:
    """Take no notice of progress."""


@dataclass(frozen=True)
class Stage:
    """One more of the `allowed` effects beside those of `best`, and where in the whole search that is."""

    best: Fit
    least: Discrepancy
    allowed: Collection[type[Effect]]
    done: float
    share: float
    progress: Progress

    def trials(self, setting: Setting, found: Screen, seen: Collection[tuple[str, str]] = ()) -> list[Fit]:
        """Return the fits with each significant effect, but for those `seen`; none where all is immaterial.

        Where none of the most significant ones is any better than no effect (an unusual shape may be significant by
        chance and then fit nowhere), the next ones are tried as well.
        """
        fits = self._fitted(setting, found, shortlist(found, self.allowed, seen))
        known = setting.whitener.repeats
        if fits and min(score(f, known) for f in fits) + found.price >= score(in_units_of(setting, self.best), known):
            fits += self._fitted(setting, found, shortlist(found, self.allowed, {*seen, *added_by(fits)}))
        return fits

    def overlooked(self, setting: Setting, found: Screen, tried: Sequence[Fit]) -> list[Fit]:
        """Return the fits of the most promising insignificant effects not `tried` yet, each in its residual's noise.

        Where the noise is known from residuals alone, an effect that is not in the model yet is part of the noise: its
        evidence is limited to a few times its own share in a band. Once it is in the model, the noise is right.
        """
        rival = score(self.best, False) - found.price
        fits = self._fitted(setting, found, promising(found, self.allowed, added_by(tried)))
        return [iterated_gls(setting, fit, rival)[1] for fit in fits]

    def _fitted(self, setting: Setting, found: Screen, picks: Sequence[int]) -> list[Fit]:
        telling = any(self._telling(setting, found, i) for i in picks)
        if not telling:
            if not any(self.least.linear):
                return []
            # the discrepancy of a linear effect follows the drive: a fit can distinguish what does not
            least = self.least.along(np.zeros(setting.data.n_outputs))
            picks = [i for i in picks if found.drops[i] >= least.of(found.shares[i])]

        def trial(k: int) -> Fit:
            candidate = found.candidates[picks[k]]
            return extended(setting, self.best, candidate, found.sizes[picks[k]], found.nuisances[picks[k]])

        fits: list[Fit] = []
        trials = side_by_side(trial, range(len(picks)), workers=setting.workers)
        for k, i in enumerate(picks):
            candidate = found.candidates[i]
            part = self.done + self.share * k / len(picks)
            self.progress(f"fitting {effect_text(candidate.effect.name)} at {candidate.where}", part)
            fits.append(next(trials))
        self.progress("refitting the best", self.done + self.share)
        return fits if telling else [f for f in fits if beyond_form(setting, self.best, f, self.least)]

    def _telling(self, setting: Setting, found: Screen, i: int) -> bool:
        """Tell whether a candidate explains more than the model discrepancy of other effects could.

        Or saves most of the nuisances' penalty: they are known too well for a model discrepancy to move them so far.
        """
        now = self.best.change
        spared = mahalanobis2_of(setting.nuisances, now) - mahalanobis2_of(
            setting.nuisances, now + found.nuisances[i][: now.size]
        )
        return bool(found.drops[i] >= self.least.of(found.shares[i]) or 2.0 * spared >= found.drops[i])


def in_units_of(setting: Setting, fit: Fit) -> Fit:
    """Return `fit` judged by another noise, its parameters as they are."""
    return replace(fit, misfit=float(np.sum(squares_of(setting, fit.residuals))), log_variance=setting.log_variance)


def added_by(fits: Sequence[Fit]) -> set[tuple[str, str]]:
    """Return the last effect of each of some fits, by name and location."""
    return {f.candidates[-1].key for f in fits}
