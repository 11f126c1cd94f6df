"""The next experiment: among the plans within the bench's limits the one that best separates what is tied."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from analysis.diagnosis.experiment.hypotheses import Hypothesis, tied_hypotheses
from analysis.diagnosis.experiment.planned import (
    LEVELS,
    Headroom,
    Played,
    bench_or_modelled,
    headroom_of,
    largest_commands,
    play_as,
    records_motion,
)
from analysis.diagnosis.experiment.reference_sensor import ReferenceSensor, watched_outputs
from analysis.diagnosis.experiment.separation import information, prediction, separation, with_spread
from analysis.diagnosis.fitting.fit import Setting
from analysis.diagnosis.result import Choice, NextExperiment, hypothesis_text
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.verdict.judging import Judgement
from campaigns.plans import Plan, all_plans
from campaigns.plans.base import rate_of
from sim_backend.bench import Bench
from sim_backend.errors import MccdError
from sim_backend.linear import Array
from sim_backend.model import Model

TRIED = 2
"""Amplitudes of each variant of a plan that are compared: the largest within the limits."""

COARSER = 8
"""Plans are compared with steps so many times longer than fits take, but none longer than a sample."""

LEAST = 3.0
"""A separation below this (in sigma) separates nothing: to name with 99 %, d²/2 has to be 4.6."""

ENOUGH = 7.0
"""With this the name is as good as certain: d²/2 = 24.5 scatters by d, and 24.5 - 2 · 7 is still above 4.6 and the
penalty for a parameter more (half the logarithm of 10⁵ samples, 5.8)."""


@dataclass(frozen=True)
class Offer:
    """A plan with what each hypothesis expects of it, and the time it takes on the bench."""

    plan: Plan
    played: tuple[Played, ...]
    duration_s: float


def choose(
    found: Found, judgement: Judgement, model: Model, bench: Bench | None = None, done: Sequence[Plan] = ()
) -> Choice | None:
    """Return the experiment that should be done next; None when the verdict needs none.

    It is one for `bench`, of which only the public description is read, or for the bench of `model`, and none of
    those `done` already. Where it cannot be chosen the reason says why.
    """
    try:
        hypotheses = tied_hypotheses(found, judgement)
        if len(hypotheses) < 2:
            return None
        description = bench_or_modelled(bench, model, found.setting.data.rate_hz)
        return _chosen(hypotheses, model, found.setting, description, done)
    except MccdError as error:
        return Choice(None, f"no next experiment can be chosen: {error}")


def _chosen(
    hypotheses: Sequence[Hypothesis], model: Model, setting: Setting, bench: Bench, done: Sequence[Plan]
) -> Choice:
    names = tuple(h.label for h in hypotheses)
    if not math.isclose(rate_of(bench), setting.data.rate_hz, rel_tol=1e-6):
        return Choice(None, f"the data were sampled at {setting.data.rate_hz:g} Hz, the bench at {rate_of(bench):g}")
    # coarse steps are enough to see which plan is best, and several times quicker
    quick = Comparison.of(hypotheses, model, replace(setting, substeps=max(setting.substeps // COARSER, 1)), bench)
    scored = [(quick.worst(offer), offer) for offer in _offers(quick, done)]
    if not scored:
        return Choice(None, "no plan keeps the limits of the bench")
    _, offer = max(scored, key=_merit)
    comparison = replace(quick, setting=setting)
    sigma = comparison.worst(replace(offer, played=comparison.played(offer.plan) or offer.played))
    if sigma < LEAST:
        causes = " from ".join(map(hypothesis_text, names))
        reason = f"no plan distinguishes {causes}: the best, {offer.plan.name}, would do so by {sigma:.2g} sigma"
        return Choice(None, reason)
    experiment = NextExperiment(offer.plan.name, offer.plan.changes(), names, sigma, offer.duration_s)
    return Choice(experiment, _reason(offer.plan, bench, model))


def _reason(plan: Plan, bench: Bench, model: Model) -> str:
    if not records_motion(plan, bench, model):
        return "no reading of the bench itself distinguishes them; an instrument beside it sees the angle itself"
    return ""


def _merit(pair: tuple[float, Offer]) -> tuple[bool, float]:
    """Return what a plan is chosen by: of all that suffice what separates most per second (d² grows with time).

    When none does, what separates most.
    """
    sigma, offer = pair
    enough = sigma >= ENOUGH
    return enough, sigma**2 / offer.duration_s if enough else sigma


def _axes(hypotheses: Sequence[Hypothesis], bench: Bench, setting: Setting) -> tuple[str, ...]:
    """Return the axes that the tied causes touch: driving others costs time and tells nothing; all, if none is one."""
    touched = {name for h in hypotheses for e in h.fit.effects for name in e.where.split("->")}
    driven = [axis for axis in bench.axes if axis in setting.places.inputs]
    return tuple(axis for axis in driven if axis in touched) or tuple(driven)


@dataclass(frozen=True)
class Comparison:
    """Hypotheses that plans are compared by, with what the data hold about the parameters of each (k, k)."""

    hypotheses: Sequence[Hypothesis]
    known: Sequence[Array]
    model: Model
    setting: Setting
    bench: Bench
    headroom: Headroom

    @classmethod
    def of(cls, hypotheses: Sequence[Hypothesis], model: Model, setting: Setting, bench: Bench) -> Self:
        """Return the comparison of hypotheses after the data of `setting`, for the limits of `bench`."""
        known = [information(setting, h) for h in hypotheses]
        # the intermediate fits of a search do not know their standard deviations well
        spread = [with_spread(setting, h, each) for h, each in zip(hypotheses, known, strict=True)]
        return cls(spread, known, model, setting, bench, headroom_of(bench, setting))

    def tells(self, plan: Plan) -> bool:
        """Tell whether a log of `plan` could tell anything: it holds the motion, or an instrument watches."""
        return records_motion(plan, self.bench, self.model) or bool(watched_outputs(plan, self.bench, self.model))

    def played(self, plan: Plan) -> tuple[Played, ...] | None:
        """Return what `plan` gives under each hypothesis, None when one of them leaves the limits."""
        out = []
        for hypothesis in self.hypotheses:
            played = play_as(plan, self.bench, self.model, hypothesis, self.setting, self.headroom)
            if played is None:
                return None
            out.append(played)
        return tuple(out)

    def worst(self, offer: Offer) -> float:
        """Return the least separation over all ordered pairs of hypotheses."""
        motion = records_motion(offer.plan, self.bench, self.model)
        sensor = ReferenceSensor(offer.plan, self.bench, self.model, self.setting, self.headroom)
        worst = math.inf
        for b, second in enumerate(self.hypotheses):
            expected, inputs = None, np.zeros(0)
            for first in (played for a, played in enumerate(offer.played) if a != b):
                own = 0.0
                if motion:
                    # open loop the inputs are the same whatever the truth, and so is what `second` expects
                    if expected is None or not np.array_equal(inputs, first.record.u):
                        expected = prediction(self.setting, second, first.record)
                        inputs = first.record.u
                    own = separation(self.setting, first.record, expected, self.known[b])
                worst = min(worst, math.hypot(own, sensor.separation(first, second)))
        return worst


def _offers(comparison: Comparison, done: Sequence[Plan]) -> Iterator[Offer]:
    """Yield the variants of every plan at the largest amplitudes within the limits under every hypothesis."""
    bench, setting = comparison.bench, comparison.setting
    axes = _axes(comparison.hypotheses, bench, setting)
    largest = np.max([np.max(np.abs(r.u), axis=0) for r in setting.data.records], axis=0)
    reach = largest_commands(axes, bench, setting.nominal, setting.places.inputs, comparison.headroom, largest)
    for cls in all_plans().values():
        taken: dict[int, int] = {}
        before = list(done)
        for level in LEVELS:
            for form, plan in enumerate(cls.offers(bench, reach.scaled(level))):
                if taken.get(form, 0) >= TRIED or plan in before or not comparison.tells(plan):
                    continue
                before.append(plan)
                played = comparison.played(plan)
                if played is not None:
                    taken[form] = taken.get(form, 0) + 1
                    yield Offer(plan, played, played[0].record.n / setting.data.rate_hz)
