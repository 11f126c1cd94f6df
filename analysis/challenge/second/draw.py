"""What a case hides: laws at sizes in proportion to their limits on the case's own bench; bad draws are drawn anew."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.challenge.second.campaign import Campaign, draw_campaign
from analysis.challenge.second.integrate import Motion, Placed
from analysis.challenge.second.law import log_uniform
from analysis.challenge.second.laws import LAWS
from analysis.challenge.second.limits import THRESHOLD, Limits, Metric, applicable, length, limits_of, placed, resized
from analysis.challenge.truth import Stratum
from sim_backend.errors import MccdError

Array = NDArray[np.float64]

CLEAR = (2.0, 30.0)
"""Sizes in naming limits."""

UNSEEN = (0.2, 0.6)
"""Sizes in detection limits of the mode that most benches have and no nominal model."""

_TRIES = 300


@dataclass(frozen=True)
class Plan:
    """What one case is to be: its stratum, and the names of the laws that it hides."""

    stratum: Stratum
    laws: tuple[str, ...] = ()


@dataclass(frozen=True)
class Drawn:
    """A case ready to be recorded; `redrawn` counts the draws that were given up, by reason."""

    plan: Plan
    campaign: Campaign
    hidden: tuple[Placed, ...]
    limits: tuple[Limits, ...]
    motions: list[Motion]
    redrawn: dict[str, int]


class BadDrawError(Exception):
    """A draw that is given up, with the reason."""


def draw_case(plan: Plan, rng: np.random.Generator) -> Drawn:
    """Return a random case of a plan. Raises MccdError where none comes out in many draws."""
    redrawn: Counter[str] = Counter()
    for _ in range(_TRIES):
        try:
            return replace(_draw(plan, rng), redrawn=dict(redrawn))
        except BadDrawError as reason:
            redrawn[str(reason)] += 1
    raise MccdError(f"no case of {' and '.join(plan.laws) or 'no law'} in {_TRIES} draws ({dict(redrawn)}): {_ADVICE}")


_ADVICE = "take another seed"


def _draw(plan: Plan, rng: np.random.Generator) -> Drawn:
    laws = [LAWS[name] for name in plan.laws]
    needs = max((law.axes for law in laws), default=1)
    campaign = draw_campaign(rng, int(rng.integers(needs, 4)))
    base = _steady(campaign)
    axes = [[a for a in range(campaign.plant.axes) if applicable(law, campaign, a)] for law in laws]
    if not all(axes):
        raise BadDrawError("the bench has no location for the law")
    metric = Metric(campaign, base)
    if rng.random() < 0.7:
        campaign = _with_unknown_mode(campaign, metric, rng)
        base = _steady(campaign)
        metric = Metric(campaign, base)
    hidden = [placed(law, campaign, base, int(rng.choice(some)), rng) for law, some in zip(laws, axes, strict=True)]
    sized, limits = [], []
    for one in hidden:
        limit = limits_of(one, metric, rng, [x for x in hidden if x is not one])
        sized.append(_sized(one, limit, plan, campaign, base, rng))
        limits.append(limit)
    return Drawn(plan, campaign, tuple(sized), tuple(limits), _played(campaign, base, sized), {})


def _steady(campaign: Campaign) -> list[Motion]:
    """Return the motion without hidden laws, of a bench that stays where it should."""
    motions = campaign.play([])
    for motion, record in zip(motions, campaign.records, strict=True):
        swing = np.sqrt(np.mean(motion.y**2, axis=0))
        if not np.all(np.isfinite(motion.y)) or np.any(np.max(np.abs(motion.y), axis=0) > 12.0 * swing):
            raise BadDrawError("unstable")
        if campaign.control is not None:
            asked = campaign.scale * np.sqrt(np.mean(record.wave**2, axis=0))
            if np.any(swing > 2.5 * asked) or np.any(swing < 0.05 * asked):
                raise BadDrawError("the loop does not follow")
            apart = motion.reading - campaign.scale * record.wave
            if np.any(np.sqrt(np.mean(apart**2, axis=0)) > 2.0 * asked):
                raise BadDrawError("unstable")
    return motions


def _with_unknown_mode(campaign: Campaign, metric: Metric, rng: np.random.Generator) -> Campaign:
    """Return the campaign on a bench with one more mode, of 0.2 to 0.6 of its detection limit."""
    plant = campaign.plant
    axis, top = int(rng.integers(plant.axes)), min(2000.0, 0.35 * campaign.rate_hz)
    omega = 2.0 * np.pi * log_uniform(rng, 0.1 * top, top)
    wider = plant.beside(omega, omega * log_uniform(rng, 3e-3, 0.05), axis, 0.01)
    d = length(metric.linear_left(wider))
    part = 0.01 * THRESHOLD * rng.uniform(*UNSEEN) / max(d, 1e-9)
    wider = plant.beside(wider.omega[-1], wider.decay[-1], axis, min(part, 0.2))
    return replace(campaign, plant=wider)


def _sized(
    one: Placed, limit: Limits, plan: Plan, campaign: Campaign, base: list[Motion], rng: np.random.Generator
) -> Placed:
    cap = one.law.cap * float(one.p[0])
    if not np.isfinite(limit.detection):
        raise BadDrawError("too small or too quick to be seen")
    if CLEAR[0] * limit.naming > cap:
        raise BadDrawError("not distinguishable at a plausible size")
    if limit.twins and plan.stratum != "one":
        raise BadDrawError("has a twin")
    size = min(log_uniform(rng, *CLEAR) * limit.naming, cap)
    return resized(one, size, campaign.scene(base, one.i))


def _played(campaign: Campaign, base: list[Motion], hidden: Sequence[Placed]) -> list[Motion]:
    """Return the motion with laws hidden, on a bench that bears them."""
    motions = campaign.play(list(hidden))
    for now, before in zip(motions, base, strict=True):
        if not np.all(np.isfinite(now.reading)):
            raise BadDrawError("unstable with the law")
        for what in ("y", "command"):
            if np.any(np.max(np.abs(getattr(now, what)), axis=0) > 4.0 * np.max(np.abs(getattr(before, what)), axis=0)):
                raise BadDrawError("out of range with the law")
    return motions
