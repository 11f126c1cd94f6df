"""Effect parameters on scales on which they are of order one, for a descent to walk on.

Sizes are relative to their natural size, shapes logarithmic where they are positive.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.candidates.signature import Candidate
from sim_backend.effects.base import Parameter
from sim_backend.linear import Array


@dataclass(frozen=True)
class Scale:
    """One parameter of effect number `effect` on a scale x of order one: the value is unit·x, or unit·exp(x) if `log`.

    `low` and `high` are the physical bounds of the value; `mean` and `sd` the normal prior of x: about one for a size,
    over the range that the effect searches for a shape. `grain` is the least step of x for a difference. `measures`
    marks the only parameter of an effect that is neutral where it is zero: its prior is wide. With a `cusp` the misfit
    over x has no tangent at its least, and no parabola describes it.
    """

    effect: int
    name: str
    unit: float
    log: bool
    size: bool
    low: float
    high: float
    mean: float
    sd: float
    grain: float
    measures: bool = False
    cusp: bool = False

    def bound(self, value: float) -> float:
        """Return a bound on this scale; minus sixty stands for a logarithm of nothing."""
        if np.isinf(value):
            return value
        if self.log and value <= 0.0:
            return -60.0
        return self.forth(value)

    def difference(self, x: float) -> float:
        """Return a step for finite differences at `x` of order one: far above rounding, far below its own size.

        Where the contribution changes in jumps, as far as it takes to change at all.
        """
        return max(1e-5 * max(abs(x), 1e-2), self.grain)

    def step(self) -> float:
        """Return how far one step may go: a factor of two on a logarithmic scale, anywhere on a linear one."""
        return 0.7 if self.log else 1e6

    def forth(self, value: float) -> float:
        """Return a physical value on this scale."""
        return float(np.log(value / self.unit)) if self.log else value / self.unit

    def back(self, x: float) -> float:
        """Return the physical value at `x`, within its bounds."""
        value = self.unit * float(np.exp(np.clip(x, -60.0, 60.0))) if self.log else self.unit * x
        return float(np.clip(value, self.low, self.high))


_ANY = 10.0
"""Standard deviation of the logarithm of what may be of any size: a range of e^±10."""

_FAINT = 1e-3
"""Part of its middle at which a shape counts as next to nothing."""


def parameters_of(candidates: Sequence[Candidate], sizes: Array) -> tuple[list[Scale], Array]:
    """Return the scales of the parameters of `candidates` that a fit searches, and its start; `sizes` as in `refit`."""
    scales: list[Scale] = []
    x: list[float] = []
    at = 0
    for i, candidate in enumerate(candidates):
        start = dict(candidate.shapes)
        width = max(len(candidate.unit_sizes), 1)
        start |= {n: sizes[at + k] * unit for k, (n, unit) in enumerate(candidate.unit_sizes.items())}
        at += width
        for p in candidate.effect.parameters():
            if p.name not in start or p.fixed or p.name in candidate.told:
                continue
            if p.log and not p.size and start[p.name] == 0.0:  # a fit ended where a logarithm has no scale
                start[p.name] = _FAINT * candidate.centres.get(p.name, 0.0)
            log = (not p.size) and p.log and start[p.name] > 0.0
            if p.size:
                unit = candidate.unit_sizes.get(p.name, 1.0)
            else:
                # a shape that a fit has left at zero keeps the scale of its starts: steps of zero's size never leave it
                middle = abs(candidate.centres.get(p.name, 0.0))
                unit = start[p.name] if log else max(abs(start[p.name]), middle, 1e-12)
            measures = log and p.neutral == 0.0 and len(candidate.effect.parameters()) == 1
            mean, sd = _prior(candidate, p, unit, log)
            sd = _ANY if measures else sd
            least, most = candidate.limits.get(p.name, (p.low, p.high))
            low, high = max(p.low, least), min(p.high, most)
            scale = Scale(
                i,
                p.name,
                unit,
                log,
                p.size,
                low,
                high,
                mean,
                sd,
                p.grain,
                measures,
                candidate.effect.whole or p.grain > 0.0,
            )
            value = float(np.clip(start[p.name], low, high))
            scales.append(scale)
            x.append(scale.forth(value))
    return scales, np.array(x)


def _prior(candidate: Candidate, p: Parameter, unit: float, log: bool) -> tuple[float, float]:
    """Return mean and standard deviation of the prior of a parameter on its scale."""
    if p.size:
        return 0.0, 1.0
    centre = candidate.centres.get(p.name, candidate.shapes.get(p.name, unit))
    if log:
        return float(np.log(max(centre, 1e-300) / unit)), p.spread
    return centre / unit, p.spread * max(abs(centre) / unit, 1.0)
