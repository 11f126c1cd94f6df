"""How large an effect must be to be seen, and to be told from its closest rival: computed, not simulated.

The *signature* of an effect is what it changes in the readings, noise-free change under the same noise. Whitened by the
true noise, its energy after all nuisances have been projected out is d². Nuisances are the nominal model's parameters,
each known to a standard deviation of 3 %/√3 (that of a uniform error of ±3 %), and the unknown state at each run's
start. For a known signature the likelihood ratio is a normal number of mean d and variance 1, so a two-sided test with
1 % false alarms detects half of all effects at

    d = THRESHOLD = 2.576.

- *Detection limit*: the size at which d reaches the threshold. No test of that false-alarm rate does better.
- *Naming limit*: the size at which the part of d that no rival explains reaches it. A rival is another cause at the
  same axis; it may explain whatever lies in the span of the signatures of several draws of its shapes, two of which
  borrow all the shapes that it shares with the truth. So a rival is rather too clever than too dull, and the limit
  rather too high.
- *Twins* are rivals that leave less than the threshold even at the largest plausible size: here no one can tell them
  from the truth, and the right answer is to say so.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import norm

from campaigns.challenge.campaign import Campaign
from campaigns.challenge.families import FAMILIES, Hidden, Scene
from campaigns.challenge.plant import NOMINAL_ERROR, Plant
from campaigns.challenge.power import random_energy

Array = NDArray[np.float64]

FALSE_ALARMS = 0.01
THRESHOLD = float(norm.isf(FALSE_ALARMS / 2.0))
PRIOR_SD = NOMINAL_ERROR / np.sqrt(3.0)

_COARSE = 2
"""Fine steps per sample for limits: the signature of an effect needs less accuracy than the data that hold it."""

_ROUNDS = 12
_CLOSE = 0.02
"""Rounds of the search for a limit, and the relative accuracy at which it ends."""

_RETUNES, _STILL, _STRIDE, _FARTHEST = 6, 0.05, 1.0, 5.0
"""Gauss–Newton steps at most; knobs (in deviations) that need no step; the longest step; the farthest start."""

_DRAWS = 3
"""Random draws per rival, besides the two that borrow the truth's shapes."""


@dataclass(frozen=True)
class Metric:
    """Inner products of whitened signatures over all samples that may be fitted, nuisances projected out.

    The nuisances are linearised about the plant turned by `knobs` (in prior standard deviations, per parameter).
    `readings` are those without effects there, `blocks` per run and axis the whitened nuisances (rows, k), the starts
    after the knobs; `factor` is the Cholesky factor of prior + N'N.
    """

    campaign: Campaign
    knobs: Array
    readings: list[Array]
    blocks: list[Array]
    factor: tuple[Array, bool]

    @classmethod
    def of(cls, campaign: Campaign, knobs: Array | None = None) -> Metric:
        """Return the metric of a campaign, about its own plant or about one turned by `knobs`."""
        coarse = campaign.coarse(_COARSE)
        knobs = np.zeros(len(places_of(campaign.plant))) if knobs is None else knobs
        plant = turned(campaign.plant, knobs)
        readings = replace(coarse, plant=plant).readings(())
        slopes = [_slope(coarse, readings, campaign.plant, knobs, i) for i in range(knobs.size)]
        n_starts = 2 * plant.n_modes * len(campaign.runs)
        blocks = []
        for r, run in enumerate(campaign.runs):
            rows = run.rows(held_out=False)
            free = _free_responses(plant, run.excitation.n, run.excitation.rate_hz)
            for a, noise in enumerate(campaign.noises):
                starts = np.zeros((run.excitation.n, n_starts))
                width = free.shape[2]
                starts[:, r * width : (r + 1) * width] = free[:, a]
                columns = np.column_stack([*(k[r][:, a] for k in slopes), starts])
                blocks.append(noise.whiten(columns)[rows])
        products = sum((b.T @ b for b in blocks), np.zeros((knobs.size + n_starts,) * 2))
        # knobs are scaled to unit prior; a start is known no better than to a thousand times what the noise leaves of
        # it
        prior = np.concatenate([np.ones(knobs.size), 1e-6 * np.maximum(np.diag(products)[knobs.size :], 1e-300)])
        return cls(coarse, knobs, readings, blocks, cho_factor(products + np.diag(prior), lower=True))

    def signature(self, hidden: Sequence[Hidden]) -> Array:
        """Return the whitened change of all fitted readings by `hidden`, one long vector (rows + knobs,).

        After the readings stand the knobs at which the metric is taken, which their prior charges for.
        """
        change = [y - b for y, b in zip(self.campaign.readings(hidden), self.readings, strict=True)]
        parts = [-self.knobs]
        for run, values in zip(self.campaign.runs, change, strict=True):
            rows = run.rows(held_out=False)
            parts += [noise.whiten(values[:, [a]])[rows, 0] for a, noise in enumerate(self.campaign.noises)]
        return np.concatenate(parts)

    def reduced(self, vectors: Array) -> Array:
        """Return the inner products (k, k) of signatures `vectors` (knobs + rows, k), nuisances projected out."""
        onto = self._onto(vectors)
        return np.asarray(vectors.T @ vectors - onto.T @ cho_solve(self.factor, onto))

    def step(self, vector: Array) -> Array:
        """Return the change of the knobs that explains most of one signature, shape (knobs,)."""
        return np.asarray(cho_solve(self.factor, self._onto(vector[:, None]))[: self.knobs.size, 0])

    def _onto(self, vectors: Array) -> Array:
        onto, at = np.zeros((self.blocks[0].shape[1], vectors.shape[1])), self.knobs.size
        onto[:at] = vectors[:at]
        for block in self.blocks:
            onto += block.T @ vectors[at : at + block.shape[0]]
            at += block.shape[0]
        return onto


@dataclass(frozen=True)
class Limits:
    """The limits of one effect in one campaign, in its size; infinite where even the largest plausible size is below.

    `twins` are (cause, where) that cannot be told from it at any plausible size; `rival` is the closest of the others.
    """

    detection: float
    naming: float
    rival: str
    twins: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class _Rival:
    slug: str
    where: str
    vectors: Array


class Distances:
    """Distances of one effect from all that the nuisances, and a rival, can explain, at any size.

    Large effects that look like a wrong nominal parameter (a shift of stiffness, say) need the nuisances re-tuned and
    not only linearised: Gauss–Newton steps, begun from the solution at the nearest size. Retuned metrics are kept by
    size.
    """

    def __init__(self, effect: Hidden, metric: Metric, beside: Sequence[Hidden]) -> None:
        self._effect = effect
        self._metric = metric
        self._others = [metric.signature([other]) for other in beside if not other.random]
        self._known: dict[float, tuple[Metric, Array]] = {}

    def __call__(self, size: float, rival: Array | None = None) -> float:
        """Return d at `size`, less what the span of `rival` (rows, k) explains."""
        metric, vector = self._known.get(size) or self._retuned(size)
        self._known[size] = (metric, vector)
        columns = [vector, *self._others] if rival is None else [vector, *self._others, rival]
        return _left(metric.reduced(np.column_stack(columns)))

    def _retuned(self, size: float) -> tuple[Metric, Array]:
        hidden = [self._effect.resized(size)]
        metric = self._metric
        if self._known:
            near = min(self._known, key=lambda s: abs(np.log(s / size)))
            knobs = np.clip(self._known[near][0].knobs * (size / near), -_FARTHEST, _FARTHEST)
            if np.max(np.abs(knobs)) > _STILL:
                metric = Metric.of(metric.campaign, knobs)
        vector = metric.signature(hidden)
        for _ in range(_RETUNES):
            step = metric.step(vector)
            if not np.max(np.abs(step)) > _STILL:
                break
            # a step is kept within what a mode's width allows
            metric = Metric.of(metric.campaign, metric.knobs + step * min(1.0, _STRIDE / float(np.max(np.abs(step)))))
            vector = metric.signature(hidden)
        return metric, vector


def limits_of(
    effect: Hidden, metric: Metric, scene: Scene, rng: np.random.Generator, beside: Sequence[Hidden] = ()
) -> Limits:
    """Return the limits of `effect`; `beside` holds other effects that act at the same time and are to be found too."""
    cap = effect.cap(scene)
    if effect.random:
        detection = _crossing(lambda size: _random_distance(effect.resized(size), metric), effect.size, cap)
        return Limits(detection, detection, "noise", ())
    distance = Distances(effect, metric, beside)
    detection = _crossing(distance, 0.05 * effect.size, cap)
    if not np.isfinite(detection):
        return Limits(np.inf, np.inf, "noise", ())
    rivals = _rivals(effect, metric, scene, rng)
    # what is left grows with the size at most in proportion, so five times the detection limit tells what the cap can
    # show
    near = min(5.0 * detection, cap)
    left = sorted(((distance(near, r.vectors), r) for r in rivals), key=lambda pair: pair[0])
    twins = tuple((r.slug, r.where) for d, r in left if d * cap / near < THRESHOLD)
    closest = [r for d, r in left if d * cap / near >= THRESHOLD][:2]
    crossings = [(_crossing(partial(distance, rival=r.vectors), near, cap), r.slug) for r in closest]
    naming, rival = max(crossings, default=(detection, "noise"))
    return Limits(detection, max(naming, detection), rival, twins)


def _rivals(effect: Hidden, metric: Metric, scene: Scene, rng: np.random.Generator) -> list[_Rival]:
    found: dict[tuple[str, str], list[Array]] = {}
    for family in FAMILIES:
        if family.slug == effect.slug or family.random or family.needs_axes > scene.n_axes:
            continue
        draws = [family.draw(rng, scene.at(effect.axis)) for _ in range(_DRAWS)]
        draws += [draws[0].borrowing(effect), draws[0].borrowing(effect, np.pi / 2.0)]
        for draw in draws:
            vector = metric.signature([draw])
            if np.all(np.isfinite(vector)):  # a borrowed shape may ask for what this bench would not survive
                found.setdefault((draw.slug, draw.where), []).append(vector)
    return [_Rival(slug, where, np.column_stack(vectors)) for (slug, where), vectors in found.items()]


def _left(products: Array) -> float:
    """Return the length of the first vector's part outside the span of the others, from inner products."""
    own, cross, inner = products[0, 0], products[1:, 0], products[1:, 1:]
    if cross.size:
        scale = np.sqrt(np.maximum(np.diag(inner), np.finfo(float).tiny))
        values, vectors = np.linalg.eigh(inner / np.outer(scale, scale))
        kept = values > 1e-9 * values[-1]
        along = vectors[:, kept].T @ (cross / scale)
        own = own - float(along @ (along / values[kept]))
    return float(np.sqrt(max(own, 0.0)))


def _crossing(distance: Callable[[float], float], start: float, cap: float) -> float:
    """Return the size at which `distance` reaches the threshold, infinite when it does not up to `cap`.

    `distance` grows with the size, for most effects in proportion: a secant in logarithms, kept within a bracket.
    """
    low, high = 0.0, np.inf
    size = min(start, cap)
    for _ in range(_ROUNDS):
        d = distance(size)
        if abs(np.log(max(d, 1e-12) / THRESHOLD)) < _CLOSE:
            return float(size)
        if d < THRESHOLD:
            if size >= cap:
                return float(np.inf)
            low = size
        else:
            high = size
        target = size * THRESHOLD / max(d, 1e-3 * THRESHOLD)
        target = min(target, 3.0 * size)  # distances need the solution at a size not far away
        inside = low < target < high
        size = min(cap, target if inside else (np.sqrt(low * high) if low > 0.0 else 0.1 * high))
    return float(high if np.isfinite(high) else np.inf)


def _random_distance(effect: Hidden, metric: Metric) -> float:
    return float(np.sqrt(random_energy(effect, metric.campaign)))


def places_of(plant: Plant) -> list[tuple[str, tuple[int, ...]]]:
    """Return which numbers of a plant the nominal model states: field and index."""
    names = ("omega_rad_s", "sigma_1_s", "b", "c")
    return [(name, tuple(int(i) for i in at)) for name in names for at in np.argwhere(getattr(plant, name) != 0.0)]


def turned(plant: Plant, knobs: Array) -> Plant:
    """Return the plant with every number that the nominal model states changed by `knobs` prior standard deviations."""
    values = {name: getattr(plant, name).copy() for name in ("omega_rad_s", "sigma_1_s", "b", "c")}
    for (name, at), knob in zip(places_of(plant), knobs, strict=True):
        values[name][at] *= np.exp(PRIOR_SD * knob)
    return plant.with_(**values)


def _slope(campaign: Campaign, readings: list[Array], plant: Plant, knobs: Array, i: int) -> list[Array]:
    """Return the change of all readings per standard deviation of one knob: a hundredth of it is still linear."""
    there = knobs.copy()
    there[i] += 0.01
    moved = replace(campaign, plant=turned(plant, there)).readings(())
    return [100.0 * (y - b) for y, b in zip(moved, readings, strict=True)]


def _free_responses(plant: Plant, n: int, rate_hz: float) -> Array:
    """Return what each axis reads of each mode's ring-down, shape (n, axes, 2 modes): its sine and its cosine."""
    time_s = np.arange(n)[:, None] / rate_hz
    damped = np.sqrt(np.maximum(plant.omega_rad_s**2 - plant.sigma_1_s**2, 0.0))
    decay = np.exp(-plant.sigma_1_s * time_s)
    ring = np.stack([decay * np.cos(damped * time_s), decay * np.sin(damped * time_s)], axis=2)
    return np.asarray((plant.c[None, :, :, None] * ring[:, None]).reshape(n, plant.n_axes, -1))
