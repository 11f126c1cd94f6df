"""What is tied after a diagnosis, each hypothesis with its fit and as a bench that would behave like it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec

from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.fitting.refit import refit
from analysis.diagnosis.nominal.tuning import turned
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.verdict.judging import Judgement, names_of
from sim_backend.assembly import retuned
from sim_backend.effects.base import Aux, Effect, Site
from sim_backend.model import EffectEntry, Model, from_linear

MOST = {"ambiguous": 3, "unknown": 2}
"""Hypotheses that an experiment is chosen for, by the verdict: the best and its closest rivals. Time grows with their
number, and none of those of an unknown verdict is adequate."""


SUSPECT = 0.7
"""A candidate whose screened evidence exceeds this part of the threshold is suspected although the model passes as
consistent: by chance in one or two of a hundred data sets (evidence of 15 among some 150 candidates)."""


@dataclass(frozen=True)
class Hypothesis:
    """A possible cause by the names it is reported by, sorted, and its fit."""

    names: tuple[str, ...]
    fit: Fit

    @property
    def label(self) -> str:
        """Return the names joined, or that there is none."""
        return "+".join(self.names) or "no further effect"

    def effects(self, setting: Setting) -> list[Effect]:
        """Return everything that acts under this hypothesis apart from chance: known effects and its own."""
        return [e for e in (*setting.known, *self.fit.effects) if e.aux is not Aux.EXOGENOUS]

    def model(self, model: Model, setting: Setting) -> Model:
        """Return `model` as this hypothesis has it, at the data's sample rate and without noise: a bench to play on.

        Its linear part is the adjusted one with all effects on it, so that only effects on signals remain effects.
        """
        effects = self.effects(setting)
        own = [e for e in effects if e in self.fit.effects]
        made = from_linear(
            retuned(turned(setting.nominal, setting.nuisances, self.fit.change), own, setting.places),
            name=model.name,
            title=model.title,
            sample_rate_hz=setting.data.rate_hz,
            inputs=model.inputs,
            outputs=model.outputs,
            origin="derived",
            source="",
        )
        return msgspec.structs.replace(
            model,
            sample_rate_hz=made.sample_rate_hz,
            modes=made.modes,
            feedthrough=made.feedthrough,
            delay_s=made.delay_s,
            effects=[_entry(e) for e in effects if e.site is not Site.MODEL],
        )


def _entry(effect: Effect) -> EffectEntry:
    values = {p.name: float(getattr(effect, p.name)) for p in effect.parameters()}
    # neutral at infinity, which is also the default, and a file holds finite numbers alone
    kept = {name: value for name, value in values.items() if math.isfinite(value)}
    return EffectEntry(effect=effect.name, where=effect.where, parameters=dict(kept))


def tied_hypotheses(found: Found, judgement: Judgement) -> list[Hypothesis]:
    """Return the hypotheses that an experiment should tell apart, best first; fewer than two when there is nothing to.

    Of an ambiguous verdict those that are tied; of an unknown one the best and its closest rivals, none of which is
    adequate, but which the right one will have to beat; of a consistent one the suspect, if there is any, and none.
    """
    if judgement.verdict == "consistent":
        suspect = _suspect(found)
        return [Hypothesis((), found.tuned), suspect] if suspect is not None else []
    if judgement.verdict not in ("ambiguous", "unknown") or not found.best.candidates:
        return []
    own = names_of(found.best.effects)
    wanted = [tuple(label.split("+")) for label, _ in judgement.rivals]
    if judgement.verdict == "ambiguous":
        tied = {name for group in judgement.tied for name in group}
        wanted = [names for names in wanted if set(names) ^ set(own) <= tied]
    hypotheses = [Hypothesis(own, found.best)]
    for names in wanted[: MOST[judgement.verdict] - 1]:
        fit = _fit_of(found, names)
        if fit is not None and math.isfinite(fit.misfit):
            hypotheses.append(Hypothesis(names, fit))
    return hypotheses


def _suspect(found: Found) -> Hypothesis | None:
    """Return the candidate that came closest to its threshold without exceeding it, if it came close."""
    screen = found.first
    for i in screen.best_per_key()[:1]:
        if screen.gains[i] >= SUSPECT * screen.threshold[i]:
            candidate = screen.candidates[i]
            fit = refit(found.setting, (candidate,), screen.sizes[i], found.tuned.change)
            if math.isfinite(fit.misfit):
                return Hypothesis((candidate.effect.reported(),), fit)
    return None


def _fit_of(found: Found, names: tuple[str, ...]) -> Fit | None:
    """Return the best fit of these causes; one that was only screened is fitted now."""
    fitted = [f for f in found.rivals if names_of(f.effects) == names]
    if fitted:
        return min(fitted, key=lambda f: f.objective)
    for i in found.first.best_per_key():
        candidate = found.first.candidates[i]
        if names == (candidate.effect.reported(),):
            return refit(found.setting, (candidate,), found.first.sizes[i], found.best.change)
    return None
