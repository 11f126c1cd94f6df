"""Bouc–Wen hysteresis: a spring that remembers, whose loops soften or stiffen as they grow."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from sim_backend.effects.base import Effect, Site, shape, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.presliding_friction import MOST_GIVE
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    # s[0] is z / reach, s[1] the last position; the equation is one over the path, in reaches
    path = (position - s[1]) / p[1]
    s[1] = position
    left, way = abs(path), (1.0 if path > 0.0 else -1.0)
    # midpoint rule in twentieths of a reach, or of z where that is larger: where z changes sign it errs most, by
    # (1/20)²/4 = 6e-4 of a reach
    while left > 0.0:
        z, slope = s[0], 0.0
        h = left
        for half in (0.5, 1.0):
            turned = 1.0 if z * way > 0.0 else -1.0
            slope = 1.0 - (abs(z) if p[3] == 1.0 else abs(z) ** p[3]) * (turned + p[2])
            if half == 0.5:
                h = min(left, 0.05 * max(1.0, abs(z)) / max(1.0, abs(slope)))
            z = min(max(s[0] + way * half * h * slope, -100.0), 100.0)
        left -= h
        # loops that soften come to rest at their limit, those that stiffen are held at theirs
        if abs(slope) < 1e-5 or z == s[0]:
            left = 0.0
        s[0] = z
    return -p[0] * p[1] * s[0]


@dataclass(frozen=True)
class BoucWen(Effect):
    """Torque -stiffness · z with dz/dx = 1 - |z/reach|^exponent (sign(z dx) + gamma_over_beta).

    In Bouc's and Wen's letters A = 1, beta = reach^-exponent and gamma = gamma_over_beta · beta: a factor common to A,
    beta, gamma and 1/stiffness changes nothing, so there is none. Above gamma_over_beta = -1 loops soften and z stays
    below reach / (1 + gamma_over_beta)^(1/exponent); at 0 this is Dahl's model; below -1 they stiffen as they grow, and
    z is kept within 100 reaches. Each step is divided and integrated by the midpoint rule.
    Source: Y. K. Wen, J. Eng. Mech. Div. ASCE 102 (1976); R. Bouc, Acustica 24 (1971).
    """

    name = "bouc-wen"
    family = "structure"
    site = Site.STRUCTURE
    cause = "hysteresis"
    symptom = "is a smooth loop over the position that depends on the last reversals and not on the speed"
    n_state = 2
    step = _step
    beyond: ClassVar = {"reach": "coulomb-friction"}

    stiffness: float = size("slope right after a reversal at z = 0", u=1, y=-1, low=0.0)
    reach: float = shape("deflection at which the loop has bent away from that slope", 1e-3, y=1, low=1e-15, spread=1.0)
    gamma_over_beta: float = shape("above -1 loops soften, below they stiffen", 0.0, low=-3.0, high=3.0, log=False)
    exponent: float = shape("how suddenly a loop bends", 1.0, low=1.0, high=8.0, spread=0.5)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return strokes from a part of the swing to beyond it, for loops that soften and that stiffen."""
        swing = max(view.position_peak, 1e-14)
        return [
            {"reach": swing * part, "gamma_over_beta": bend, "exponent": 1.0}
            for bend in (0.5, -1.5)
            for part in (0.15, 0.5, 1.5)
        ]

    @classmethod
    def limits(cls, view: RecordView) -> dict[str, tuple[float, float]]:
        """Return strokes beyond those within which friction reverses."""
        return {"reach": (max(MOST_GIVE * view.swing, 1e-15), math.inf)}
