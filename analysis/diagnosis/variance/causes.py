"""Causes that show only in the quantisation, variance or colour of the residual: collected, weighed, and named.

They have no signature that a residual could be compared with, so the search does not see them. The residual of the
search is tested for each, with one false-alarm rate for all together.
"""

from __future__ import annotations

import math
from collections.abc import Container
from dataclasses import dataclass, replace

from analysis.diagnosis.fitting.balance import in_noise
from analysis.diagnosis.fitting.discrepancy import Discrepancy
from analysis.diagnosis.fitting.fit import Fit, Setting, linear_of
from analysis.diagnosis.fitting.starts import without_starts
from analysis.diagnosis.noise.whitener import Bands, louder
from analysis.diagnosis.result import Cause, Estimate, Verdict
from analysis.diagnosis.search.shortlist import SURE, SURE_LEAD
from analysis.diagnosis.variance.broadband import broadband
from analysis.diagnosis.variance.chance import FALSE_ALARM, Chance
from analysis.diagnosis.variance.late_readings import late_readings
from analysis.diagnosis.variance.quantisation import rounded_readings
from analysis.diagnosis.variance.repeats import lost_samples
from analysis.diagnosis.variance.uneven_noise import uneven_noise
from analysis.diagnosis.verdict.judging import Judgement
from sim_backend.effects.base import Effect
from sim_backend.model import Model
from sim_backend.modes import units_at

KINDS = 5
"""Tests of every output: quantisation, repeats, late readings, uneven noise, and noise that came through the plant.
"""


@dataclass(frozen=True)
class VarianceEffects:
    """The significant ones of these causes, and how many were tested."""

    causes: tuple[Chance, ...]
    tests: int

    @property
    def allowed(self) -> float:
        """By how much, at most, they raise the mean square of the whitened residual."""
        return sum(c.allowed for c in self.causes)

    def share(self, rows: int) -> float:
        """Return how much of a sum of squares over `rows`, concentrated in a few columns, variance effects may explain.

        As much in a few columns is evidence of them, half of it in logarithms; and no more than they add in all. What
        makes noise louder has its share in that, see `beside`.
        """
        return sum(min(2.0 * c.evidence, c.allowed * rows) for c in self.causes if c.louder is None)

    @property
    def louder(self) -> tuple[Bands, ...]:
        """How strong some of them make the noise."""
        return tuple(c.louder for c in self.causes if c.louder is not None)

    def beside(self, setting: Setting, fit: Fit) -> Setting:
        """Return the setting in which the noise is as strong as these causes make it."""
        if not self.louder:
            return setting
        return in_noise(setting, louder(setting.whitener, self.louder), fit)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects that are sure."""
        return tuple(c.effect for c in self.causes if self.probability(c) >= SURE)

    def probability(self, cause: Chance) -> float:
        """Return the probability of a cause against nothing (one of so many tests) and its rivals."""
        against = math.log(self.tests) - cause.evidence
        terms = [math.exp(min(x, 700.0)) for x in (against, *(-gap for _, gap in cause.rivals))]
        return 1.0 / (1.0 + math.fsum(terms))

    def ties(self) -> tuple[tuple[str, ...], ...]:
        """Return, for each cause that is not sure, its name with those of the rivals that come close."""
        unsure = [c for c in self.causes if self.probability(c) < SURE]
        return tuple(
            (c.effect.reported(), *dict.fromkeys(name for name, gap in c.rivals if gap < SURE_LEAD)) for c in unsure
        )

    def joined(self, judgement: Judgement) -> Judgement:
        """Return the verdict with these causes; an unknown one stays, for they do not explain what made it so."""
        if not self.causes or judgement.verdict == "unknown":
            return judgement
        ties = self.ties()
        tied = tuple(dict.fromkeys((*judgement.tied, *ties)))
        sure = [self.probability(c) for c in self.causes if self.probability(c) >= SURE]
        verdict: Verdict = "ambiguous" if tied else "named"
        return replace(judgement, verdict=verdict, tied=tied, probability=min([judgement.probability, *sure]))

    def named(self, judgement: Judgement, model: Model) -> tuple[Cause, ...]:
        """Return the sure ones with their parameters, none where the verdict is unknown."""
        if judgement.verdict == "unknown":
            return ()
        return tuple(
            Cause(
                c.effect.reported(),
                c.effect.where,
                self.probability(c),
                _estimates(c, model),
                f"the residual {c.effect.symptom}",
            )
            for c in self.causes
            if self.probability(c) >= SURE
        )


def _estimates(cause: Chance, model: Model) -> dict[str, Estimate]:
    u, y = units_at(model, cause.effect.where)
    dimensions = {p.name: p.dimension for p in cause.effect.parameters()}
    return {
        name: Estimate(float(getattr(cause.effect, name)), std, dimensions[name].unit(u, y))
        for name, std in cause.std.items()
    }


def variance_effects(
    setting: Setting, fit: Fit, searched: Container[type[Effect]], discrepancy: Discrepancy
) -> VarianceEffects:
    """Return the causes of this kind that are significant in the residual of `fit`.

    Causes that are not `searched`, that are in `fit` already, or that the model discrepancy of its effects
    (`discrepancy`) could explain, are left out.
    """
    tests = KINDS * setting.data.n_outputs
    if setting.whitener.even:  # the variance of a large error hides that of the noise
        return VarianceEffects((), tests)
    # what a start adds is no noise
    left = without_starts(setting.data, linear_of(setting, fit), setting.whitener, fit.residuals)
    fit = replace(fit, residuals=left)
    lost = lost_samples(setting, fit)
    repeating = {cause.effect.where for cause in lost}
    found = [
        *rounded_readings(setting),
        *lost,
        *(cause for cause in late_readings(setting, fit) if cause.effect.where not in repeating),
        *uneven_noise(setting, fit),
        *broadband(setting, fit),
    ]
    least = 2.0 * (SURE_LEAD + math.log(tests))
    there = {(e.reported(), e.where) for e in fit.effects}
    kept = [
        c
        for c in found
        if type(c.effect) in searched
        and (c.effect.reported(), c.effect.where) not in there
        and c.p_value < FALSE_ALARM / tests
        and 2.0 * c.evidence > least
        and c.shift**2 > least
        # repeats are seen on the readings alone, so no error of the model can stand for them
        and (c in lost or c.shift**2 > discrepancy.at(c.effect.where))
    ]
    return VarianceEffects(tuple(kept), tests)
