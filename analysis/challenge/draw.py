"""What a case hides: by stratum, effects at sizes in proportion to their limits in the case's own campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.challenge.campaign import Campaign, draw_campaign
from analysis.challenge.experiment import SHAPES
from analysis.challenge.families import Hidden, Scene, members
from analysis.challenge.families.base import log_uniform
from analysis.challenge.families.structure import ExtraResonance
from analysis.challenge.limits import Limits, detection_limit, limits_of
from analysis.challenge.metric import Metric
from analysis.challenge.truth import Stratum
from sim_backend.errors import ConfigError

CLEAR = (2.0, 30.0)
"""Sizes in naming limits of effects that must be named."""

UNSEEN = (0.2, 0.6)
"""Sizes in detection limits of the small modes that every hidden bench has besides."""

FAINT = (0.4, 4.0)
"""Sizes in detection limits of effects that measure where detection begins."""

_TRIES = 30


@dataclass(frozen=True)
class Plan:
    """What one case is to be: its stratum, the causes it hides, and the shape of its campaign (None for any)."""

    stratum: Stratum
    slugs: tuple[str, ...]
    shape: str | None = None


@dataclass(frozen=True)
class Drawn:
    """A case ready to be recorded."""

    plan: Plan
    shape: str
    campaign: Campaign
    parasites: tuple[Hidden, ...]
    hidden: tuple[Hidden, ...]
    limits: tuple[Limits, ...]


def draw_case(plan: Plan, rng: np.random.Generator) -> Drawn:
    """Return a random case of this plan.

    What is public (shape, axes) is drawn first; bench and locations are drawn again until the effects fit below the
    largest plausible sizes. Raises ConfigError when that never happens.
    """
    needs = max((f.needs_axes for slug in plan.slugs for f in members(slug)), default=1)
    shape = plan.shape or str(rng.choice(list(SHAPES), p=list(SHAPES.values())))
    n_axes = max(needs, 1 + int(rng.random() < 0.5))
    for _ in range(_TRIES):
        campaign = draw_campaign(rng, shape, n_axes)
        scene, metric = campaign.scene(), Metric.of(campaign)
        found = _effects(plan, scene, metric, rng)
        if found is not None:
            return Drawn(plan, shape, campaign, _parasites(scene, metric, rng), *found)
    raise ConfigError(
        f"no bench in {_TRIES} shows {' and '.join(plan.slugs)} in a campaign of shape '{shape}' at a plausible size; "
        "leave the family out or make the campaigns longer"
    )


def separable(families: Sequence[str], rng: np.random.Generator) -> tuple[str, ...]:
    """Return the families without a twin, as computed for one member of each in a short campaign on the fewest axes.

    Where a twin remains in the search, it is no fault to name it, and in a pair neither can be required by name.
    """
    found = []
    for slug in families:
        family = members(slug)[0]
        campaign = draw_campaign(rng, "short", family.needs_axes)
        scene, metric = campaign.scene(), Metric.of(campaign)
        if not limits_of(family.draw(rng, scene), metric, scene, rng).twins:
            found.append(slug)
    return tuple(found)


def _effects(
    plan: Plan, scene: Scene, metric: Metric, rng: np.random.Generator
) -> tuple[tuple[Hidden, ...], tuple[Limits, ...]] | None:
    effects: list[Hidden] = []
    limits: list[Limits] = []
    for slug in plan.slugs:
        family = members(slug)[int(rng.integers(len(members(slug))))]
        effect = family.draw(rng, scene)
        found = limits_of(effect, metric, scene, rng, effects)
        size = _size(plan.stratum, effect, found, scene, rng)
        if size is None:
            return None
        effects.append(effect.resized(size))
        limits.append(found)
    return tuple(effects), tuple(limits)


def _parasites(scene: Scene, metric: Metric, rng: np.random.Generator) -> tuple[Hidden, ...]:
    """Return small modes that no model has, one per axis, each too small to be found."""
    modes = [ExtraResonance.draw(rng, scene.at(axis)) for axis in range(scene.n_axes)]
    return tuple(m.resized(rng.uniform(*UNSEEN) * detection_limit(m, metric, scene)) for m in modes)


def _size(stratum: Stratum, effect: Hidden, limits: Limits, scene: Scene, rng: np.random.Generator) -> float | None:
    low, high = FAINT if stratum == "faint" else CLEAR
    unit = limits.detection if stratum == "faint" else limits.naming
    cap = effect.cap(scene)
    if not low * unit < cap or (stratum in ("two", "outside") and limits.twins):
        return None
    return log_uniform(rng, low * unit, min(high * unit, cap))
