"""How large a hidden law must be to be seen, and to be distinguished from every listed one: from this simulator alone.

The *signature* of a law is what it changes in the readings beyond what the linear plant makes of the change that it
causes in the commands: (reading with − without) − plant·(command with − without). So it is the same in a position loop
as in an open one, and it is whitened by the sensor's own noise. What nuisances explain is taken out: every number
of the nominal model, adjusted under the prior of a uniform error of ±5 %, and the state in which each run begins, with
a prior as wide as the motion. d² is the remaining energy over the samples that may be fitted.

- *Detection limit*: the size at which d = 2.576, as of the first generator.
- *Naming limit*: the size at which the part of d that no rival explains is 2.576. A rival is any other listed name at
  the same axis, by two draws of its shapes to first order; whatever weighted sum of these counts.
- *Twin*: a rival that leaves less than 2.576 even at the largest plausible size.

What the limit leaves out: rivals are few draws along the undisturbed motion, one name at a time; rivals at other axes
do not count; the part that a rival leaves is taken to grow in proportion to the size; where samples are lost or late at
random the signature counts as known. All of these make the limit too low rather than too high.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.challenge.second.along import first_order
from analysis.challenge.second.campaign import Campaign
from analysis.challenge.second.integrate import Motion, Placed
from analysis.challenge.second.law import Law, Scene
from analysis.challenge.second.laws import LAWS
from analysis.challenge.second.nuisances import Left, Projection, tune, whitened
from analysis.challenge.second.plant import Plant

Array = NDArray[np.float64]

THRESHOLD = 2.575829303548901
"""Half of all effects are detected where d is this, at 1 % false alarms (two-sided)."""

_ROUNDS, _CLOSE, _DRAWS = 14, 0.05, 2

_QUICKEST = 30.0
"""How fast a law may react, times the sample rate: what is quicker is not drawn."""


@dataclass(frozen=True)
class Limits:
    """Limits in the size of a law, the closest rival, and the names that no one can tell from it."""

    detection: float
    naming: float
    rival: str
    twins: tuple[str, ...]


class Metric:
    """Distances in units of the noise, beyond what nuisances explain, from the motion without hidden laws."""

    def __init__(self, campaign: Campaign, base: Sequence[Motion]) -> None:
        self.campaign, self.base = campaign, list(base)
        self._first = Projection.about(campaign, campaign.plant, base)

    def left(self, laws: list[Placed]) -> Left | None:
        """Return what tuned nuisances leave of the signature of laws; None where the bench does not bear them."""
        changed = self.campaign.play(laws)
        parts = []
        for now, before in zip(changed, self.base, strict=True):
            if not np.all(np.isfinite(now.reading)) or np.max(np.abs(now.y)) > 10.0 * np.max(np.abs(before.y)):
                return None
            change, command = now.reading - before.reading, now.command - before.command
            parts.append(change - self.campaign.answer(command) if np.any(command) else change)
        return tune(self.campaign, self._first, changed, parts)

    def linear_left(self, plant: Plant) -> Array:
        """Return what nuisances leave of a change of the linear plant, to first order, (rows + q,)."""
        parts = [self.campaign.answer(m.command, plant) - self.campaign.answer(m.command) for m in self.base]
        return self._first.beyond(whitened(self.campaign, parts)[:, None])[:, 0]

    def first_order(self, one: Placed) -> Array:
        """Return the whitened signature of a law along the undisturbed motion, (rows,)."""
        return whitened(self.campaign, [first_order(one, self.campaign, m, i) for i, m in enumerate(self.base)])


def length(vector: Array) -> float:
    """Return the length of a vector (n,)."""
    return float(np.sqrt(np.sum(vector**2)))


def left_by(vector: Array, others: Array) -> float:
    """Return the length of what a weighted sum of others (rows, k) leaves of a vector."""
    norms = np.sqrt(np.sum(others**2, axis=0))
    kept = others[:, norms > 0.0] / norms[norms > 0.0]
    if not kept.size:
        return length(vector)
    basis, _, _ = np.linalg.svd(kept, full_matrices=False)
    return length(vector - basis @ (basis.T @ vector))


def applicable(law: Law, campaign: Campaign, axis: int) -> bool:
    """Tell whether a law can act at an axis."""
    return law.axes <= campaign.plant.axes <= law.most_axes and not (law.springy and campaign.plant.rigid(axis))


def placed(law: Law, campaign: Campaign, motions: list[Motion], axis: int, rng: np.random.Generator) -> Placed:
    """Return a law at an axis with drawn shapes and its usual size."""
    scene = campaign.scene(motions, axis)
    others = [a for a in range(campaign.plant.axes) if a != axis] or [axis]
    p = np.array([law.size(scene), *law.shapes(rng, scene)])
    return Placed(law, p, axis, int(rng.choice(others)), law.rate(p, scene))


def resized(one: Placed, size: float, scene: Scene) -> Placed:
    """Return a placed law at another size."""
    p = np.array([size, *one.p[1:]])
    return replace(one, p=p, rate=one.law.rate(p, scene))


def limits_of(one: Placed, metric: Metric, rng: np.random.Generator, beside: Sequence[Placed] = ()) -> Limits:
    """Return the limits of a placed law; what acts `beside` it counts as a nuisance of unknown size."""
    others = [metric.first_order(x) for x in beside]
    limit, left = _detection(one, metric, others)
    if left is None or not np.isfinite(limit):
        return Limits(np.inf, np.inf, "noise", ())
    free = left.projection.beyond(np.stack(others, axis=1)) if others else np.zeros((left.vector.size, 0))
    cap, own = one.law.cap * float(one.p[0]), left_by(left.vector, free)
    parts = {}
    for name, signatures in _rivals(one, metric, rng).items():
        parts[name] = left_by(left.vector, np.hstack([free, left.projection.beyond(signatures)])) / own
    twins = tuple(n for n, part in parts.items() if part * own * cap / limit < THRESHOLD)
    hard = {n: part for n, part in parts.items() if n not in twins}
    rival, part = min(hard.items(), key=lambda item: item[1], default=("noise", 1.0))
    return Limits(limit, limit / min(part, 1.0), rival, twins)


def _detection(one: Placed, metric: Metric, others: list[Array]) -> tuple[float, Left | None]:
    """Return the detection limit, infinite above the largest plausible size, and what nuisances leave there."""
    cap = one.law.cap * float(one.p[0])
    size, low, high = 0.1 * float(one.p[0]), 0.0, np.inf
    before: tuple[float, float] | None = None
    scene = metric.campaign.scene(metric.base, one.i)
    for _ in range(_ROUNDS):
        trial = resized(one, size, scene)
        if trial.rate > _QUICKEST * metric.campaign.rate_hz:
            return np.inf, None
        left = metric.left([trial])
        if left is None:
            high, size = size, 0.2 * size
            continue
        free = left.projection.beyond(np.stack(others, axis=1)) if others else np.zeros((left.vector.size, 0))
        d = max(left_by(left.vector, free), 1e-9)
        if abs(np.log(d / THRESHOLD)) < _CLOSE:
            return size, left
        if d < THRESHOLD:
            if size >= cap:
                return np.inf, None
            low = size
        else:
            high = size
        power = 1.0
        if before is not None and before[0] != size:
            power = float(np.clip(np.log(d / before[1]) / np.log(size / before[0]), 0.5, 4.0))
        before = (size, d) if d > 0.1 else None  # below, a law has hardly begun to act, and its slope tells nothing
        target = size * float(np.clip((THRESHOLD / d) ** (1.0 / power), 1e-3, 30.0))
        inside = low < target < high
        size = min(cap, target if inside else (np.sqrt(low * high) if low > 0.0 else 0.3 * high))
    return np.inf, None


def _rivals(one: Placed, metric: Metric, rng: np.random.Generator) -> dict[str, Array]:
    """Return the signatures (rows, k) of every other listed name at the same axis, by draws of its shapes."""
    campaign = metric.campaign
    found: dict[str, list[Array]] = {}
    for law in LAWS.values():
        if (
            law.group != "listed"
            or law.effect == one.law.effect
            or not applicable(replace(law, most_axes=3), campaign, one.i)
        ):
            continue
        for _ in range(_DRAWS if law.shapes(rng, campaign.scene(metric.base, one.i)) else 1):
            rival = placed(law, campaign, metric.base, one.i, rng)
            vector = metric.first_order(replace(rival, j=one.j) if law.axes > 1 and one.law.axes > 1 else rival)
            if np.all(np.isfinite(vector)):
                found.setdefault(law.effect, []).append(vector)
    return {name: np.column_stack(vectors) for name, vectors in found.items()}
