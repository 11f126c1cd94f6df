"""How large an effect must be to be seen, and to be distinguished from its closest rival: computed, not simulated.

The *signature* of an effect is what it changes in the readings, noise-free change under the same noise. Whitened by the
true noise, its energy after all nuisances have been projected out is d². Nuisances are the nominal model's parameters,
each known to a standard deviation of 3 %/√3 (that of a uniform error of ±3 %), and the unknown state at each run's
start. For a known signature the likelihood ratio is a normal number of mean d and variance 1, so a two-sided test with
1 % false alarms detects half of all effects at

    d = THRESHOLD = 2.576.

- *Detection limit*: the size at which d reaches the threshold. No test of that false-alarm rate does better.
- *Naming limit*: the size at which the part of d that no rival explains reaches it. A rival is another cause at the
  same axis; it may explain whatever is a weighted sum of the signatures of several draws of its shapes and sizes, some
  of which borrow the shapes that it shares with the truth. Weights are of either sign, but for causes that have only
  one (friction opposes motion). So a rival is rather too flexible than too rigid, and the limit rather too high.
- *Twins* are rivals that leave less than the threshold even at the largest plausible size: no one can distinguish them
  from the truth, and the right answer is to say so.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.challenge.campaign import Campaign
from analysis.challenge.families import FAMILIES, Hidden, Scene, members
from analysis.challenge.families.base import log_uniform
from analysis.challenge.metric import Metric, Seen
from analysis.challenge.power import energy_beyond_amplifiers, random_energy

Array = NDArray[np.float64]

FALSE_ALARMS = 0.01
THRESHOLD = 2.575829303548901
"""`scipy.stats.norm.isf(FALSE_ALARMS / 2)`, written out: it takes a second to import what computes it."""

_ROUNDS = 12
_CLOSE = 0.02
"""Rounds of the search for a limit, and the relative accuracy at which it ends."""

_ADJUSTMENTS, _STILL, _STRIDE, _FARTHEST = 8, 0.005, 1.0, 5.0
"""Most Gauss–Newton steps; nuisance change (in deviations) that needs no step; longest step; farthest start."""

_GROWTH = 1.5
"""Nuisances are followed to larger sizes by such a factor at a time: from far off a sharp mode is not found again."""

_FEW, _MANY, _CLOSEST = 3, 10, 4
"""Draws of every rival, of the closest ones, and how many these are."""

_CHARGE = 1e-5

_DIRECTION = 1e-6
"""Part of a drawn size that shows a signature's direction. A shift of a number that the nominal model states as well
has to be that number's own column: what bends away from it at its size would be large beside the prior."""

_AMPLIFIER = "amplifier-noise"
"""Noise that a bench is known to have: no family of its own, but a rival of vibration."""

_SIZES = (0.05, 1.5)
"""Sizes of drawn rivals over those at which they are drawn: the shape of some depends on their size."""


@dataclass(frozen=True)
class Limits:
    """The limits of one effect in one campaign, in its size; infinite where even the largest plausible size is below.

    `twins` are (cause, where) that cannot be distinguished from it at any plausible size; `rival` is the closest of the
    others.
    """

    detection: float
    naming: float
    rival: str
    twins: tuple[tuple[str, str], ...]


class Rivals:
    """What every other cause could make of the same readings: draws of each rival by cause and location.

    Their signatures are those on the plant about which a metric is taken. Those in the first metric, which all share,
    are cached.
    """

    def __init__(self, drawn: dict[tuple[str, str], list[Hidden]], first: Metric) -> None:
        self.drawn = drawn
        self._first = first
        self._known: dict[tuple[str, str], Seen] = {}

    def seen(self, metric: Metric, key: tuple[str, str]) -> Seen:
        """Return the signatures of one rival as a metric sees them."""
        if metric is not self._first:
            return self._seen(metric, key)
        if key not in self._known:
            self._known[key] = self._seen(metric, key)
        return self._known[key]

    def _seen(self, metric: Metric, key: tuple[str, str]) -> Seen:
        vectors = [metric.change([effect]) for effect in self.drawn[key]]
        # a borrowed shape may ask for what this bench would not survive
        whole = [v for v in vectors if np.all(np.isfinite(v))]
        return metric.seen(np.column_stack(whole) if whole else np.zeros((vectors[0].size, 0)))

    @classmethod
    def of(cls, effect: Hidden, metric: Metric, scene: Scene, rng: np.random.Generator) -> Rivals:
        """Return the rivals of `effect` at its axis, each by a few draws."""
        families = [f for f in FAMILIES if f.slug != effect.slug and not f.random and f.needs_axes <= scene.n_axes]
        return cls(_drawn(families, _FEW, effect, scene, rng), metric)

    def closer(self, keys: Sequence[tuple[str, str]], effect: Hidden, scene: Scene, rng: np.random.Generator) -> Rivals:
        """Return the rivals `keys` alone, each by many more draws."""
        families = [f for slug in dict.fromkeys(slug for slug, _ in keys) for f in members(slug)]
        more = _drawn(families, _MANY, effect, scene, rng)
        return Rivals({key: [*self.drawn[key], *more.get(key, [])] for key in keys}, self._first)


def _drawn(
    families: Sequence[type[Hidden]], draws: int, effect: Hidden, scene: Scene, rng: np.random.Generator
) -> dict[tuple[str, str], list[Hidden]]:
    drawn: dict[tuple[str, str], list[Hidden]] = {}
    for family in families:
        for relative in _relatives(family, draws, effect, scene.at(effect.axis), rng):
            drawn.setdefault((relative.slug, relative.where), []).append(relative)
    return drawn


def _relatives(
    family: type[Hidden], draws: int, effect: Hidden, scene: Scene, rng: np.random.Generator
) -> list[Hidden]:
    """Return the draws that represent a rival: of its shapes and sizes, and one that borrows the shapes of `effect`.

    Of a rival whose signature has one shape at any size, one draw is all.
    """
    first = family.draw(rng, scene)
    if family.proportional and not first.shapes():
        return [first.resized(_DIRECTION * first.size)]
    others = [first, *(family.draw(rng, scene) for _ in range(draws - 1))]
    sized = [other.resized(other.size * log_uniform(rng, *_SIZES)) for other in others]
    if set(first.shapes()) & set(effect.shapes()):
        sized.append(first.borrowing(effect))
        if "phase" in first.shapes():
            sized.append(first.borrowing(effect, np.pi / 2.0))
    return sized


class Distances:
    """Distances of one effect from all that the nuisances, and a rival, can explain, at any size.

    Large effects that look like a wrong nominal parameter (a shift of stiffness, say) need the nuisances adjusted and
    not only linearised: Gauss–Newton steps, begun from the solution at the nearest size.
    """

    def __init__(self, effect: Hidden, metric: Metric, beside: Sequence[Hidden]) -> None:
        self._effect = effect
        self._metric = metric
        self._others = [metric.signature([other]) for other in beside if not other.random]
        self._known: dict[float, tuple[Metric, Array]] = {}

    def alone(self, size: float) -> float:
        """Return d at `size`."""
        metric, vector = self._at(size)
        return _left(metric.seen(np.column_stack([vector, *self._others])).products())

    def beyond(self, size: float, rivals: Rivals, keys: Sequence[tuple[str, str]]) -> list[float]:
        """Return, per rival in `keys`, what it leaves of d at `size`."""
        metric, vector = self._at(size)
        own = metric.seen(np.column_stack([vector, *self._others]))
        inner, found = own.products(), []
        for key in keys:
            seen = rivals.seen(metric, key)
            one_sided = seen.vectors.shape[1] if members(key[0])[0].one_sided else 0
            found.append(_left(_bordered(inner, own.products(seen), seen.products()), one_sided))
        return found

    def beyond_one(self, rivals: Rivals, key: tuple[str, str], size: float) -> float:
        """Return what one rival leaves of d at `size`."""
        return self.beyond(size, rivals, [key])[0]

    def _at(self, size: float) -> tuple[Metric, Array]:
        if size not in self._known:
            while self._known and (near := self._nearest(size)) * _GROWTH < size and self._moved(near):
                self._known[near * _GROWTH] = self._adjusted(near * _GROWTH)
            self._known[size] = self._adjusted(size)
        return self._known[size]

    def _nearest(self, size: float) -> float:
        return min(self._known, key=lambda s: abs(np.log(s / size)))

    def _moved(self, size: float) -> bool:
        """Tell whether the nominal numbers follow the effect at a size that is known."""
        return bool(np.max(np.abs(self._known[size][0].tuned)) > _STILL)

    def _adjusted(self, size: float) -> tuple[Metric, Array]:
        hidden = [self._effect.resized(size)]
        metric = self._metric
        if self._known:
            near = self._nearest(size)
            tuned = np.clip(self._known[near][0].tuned * (size / near), -_FARTHEST, _FARTHEST)
            if np.max(np.abs(tuned)) > _STILL:
                metric = Metric.of(metric.campaign, tuned)
        vector = metric.signature(hidden)
        for _ in range(_ADJUSTMENTS):
            step = metric.step(vector)
            if not np.max(np.abs(step)) > _STILL:
                break
            # a step is kept within what a mode's width allows
            metric = Metric.of(metric.campaign, metric.tuned + step * min(1.0, _STRIDE / float(np.max(np.abs(step)))))
            vector = metric.signature(hidden)
        return metric, vector


def detection_limit(effect: Hidden, metric: Metric, scene: Scene) -> float:
    """Return the detection limit of an effect by itself."""
    return _crossing(Distances(effect, metric, ()).alone, 0.05 * effect.size, effect.cap(scene))


def limits_of(
    effect: Hidden, metric: Metric, scene: Scene, rng: np.random.Generator, beside: Sequence[Hidden] = ()
) -> Limits:
    """Return the limits of `effect`; `beside` holds other effects that act at the same time and are to be found too."""
    cap = effect.cap(scene)
    if effect.random:
        return _limits_of_chance(effect, metric, cap)
    distances = Distances(effect, metric, beside)
    detection = _crossing(distances.alone, 0.05 * effect.size, cap)
    if not np.isfinite(detection):
        return Limits(np.inf, np.inf, "noise", ())
    rivals = Rivals.of(effect, metric, scene, rng)
    # the residual grows with the size at most in proportion, so five times the detection limit shows what the cap does
    near = min(5.0 * detection, cap)
    first = sorted(zip(distances.beyond(near, rivals, list(rivals.drawn)), rivals.drawn, strict=True))
    closest = rivals.closer([key for _, key in first[:_CLOSEST]], effect, scene, rng)
    left = sorted(zip(distances.beyond(near, closest, list(closest.drawn)), closest.drawn, strict=True))
    twins = tuple(key for d, key in left if d * cap / near < THRESHOLD)
    hard = [key for d, key in left if d * cap / near >= THRESHOLD][:2]
    crossings = [(_crossing(partial(distances.beyond_one, closest, key), near, cap), key[0]) for key in hard]
    naming, rival = max(crossings, default=(detection, "noise"))
    return Limits(detection, max(naming, detection), rival, twins)


def _bordered(inner: Array, cross: Array, among: Array) -> Array:
    return np.block([[inner, cross], [cross.T, among]])


def _left(products: Array, one_sided: int = 0) -> float:
    """Return the length of the first vector's part that the others leave, from inner products.

    The last `one_sided` of them may be added only, all others with either sign: least squares without negative weights,
    in which a free vector stands for itself and its opposite.
    """
    scale = np.sqrt(np.maximum(np.diag(products), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(products / np.outer(scale, scale))
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    target, others = root[:, 0], root[:, 1:]
    if not others.size:
        return float(scale[0])
    free = others[:, : others.shape[1] - one_sided]
    columns = np.column_stack([others, -free])
    # a hundred-thousandth of each weight is charged, so that no two nearly equal signatures are set against each other
    charged = np.vstack([columns, _CHARGE * np.eye(columns.shape[1])])
    weights, _ = scipy.optimize.nnls(
        charged, np.concatenate([target, np.zeros(columns.shape[1])]), maxiter=50 * columns.shape[1]
    )
    return float(scale[0] * np.linalg.norm(target - columns @ weights))


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


def _limits_of_chance(effect: Hidden, metric: Metric, cap: float) -> Limits:
    """Return the limits of an effect that has no signature: by what it adds to the spectrum or to single samples."""

    def crossing(energy: Callable[[Hidden, Campaign], float], start: float) -> float:
        return _crossing(lambda size: float(np.sqrt(energy(effect.resized(size), metric.campaign))), start, cap)

    detection = crossing(random_energy, effect.size)
    if not np.isfinite(detection):
        return Limits(np.inf, np.inf, "noise", ())
    naming = max(crossing(energy_beyond_amplifiers, detection), detection)
    if np.isfinite(naming):
        return Limits(detection, naming, "noise" if naming == detection else _AMPLIFIER, ())
    return Limits(detection, naming, _AMPLIFIER, ((_AMPLIFIER, effect.where),))
