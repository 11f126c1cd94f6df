"""Jiles–Atherton hysteresis: magnetic material in the actuators is magnetised by the motion, with memory."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, constant, shape, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.presliding_friction import MOST_GIVE
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    # field H is the position; s[0] is the last field, s[1] the magnetisation M
    pinning, c, alpha, saturation = p[2], p[3], p[4], p[5]
    change = position - s[0]
    if change != 0.0:
        rising = change > 0.0
        # sub-increments of a twentieth of the field in which M changes; Heun's error over it is (1/20)²/6 = 4e-4 of M
        widest = 0.05 * min(pinning, p[1])
        parts = 1 if abs(change) <= widest else math.ceil(min(abs(change) / widest, 200.0))
        dh = change if parts == 1 else change / parts
        per_a = 1.0 / p[1]
        h, m = s[0], s[1]
        for _ in range(parts):
            m0, slope0 = m, 0.0
            for stage in range(2):
                x = (h + alpha * m) * per_a
                if abs(x) < 0.05:
                    # series of coth x - 1/x and its derivative: the next terms are below 1e-10 of them
                    square = x * x
                    man = saturation * x * (1.0 / 3.0 - square * (1.0 / 45.0 - square * (2.0 / 945.0)))
                    dman = saturation * per_a * (1.0 / 3.0 - square * (1.0 / 15.0 - square * (2.0 / 189.0)))
                else:
                    coth, inverse = 1.0 / math.tanh(x), 1.0 / x
                    man = saturation * (coth - inverse)
                    dman = saturation * per_a * (1.0 - coth * coth + inverse * inverse)
                gap = man - m
                # dMan/dH = Man'(He) (1 + alpha dM/dH): with c and the irreversible part over 1 + c,
                # (1 + c - alpha c Man') dM/dH = irreversible + c Man'
                bends, over = c * dman, max(1.0 + c - alpha * c * dman, 0.01)
                # the susceptibility is unbounded where the coupling beats the pinning: kept at 100 × the rest. M moves
                # irreversibly only towards Man, where delta, the sign of the change, is that of the gap and cancels
                pin = max(pinning - alpha * abs(gap), 0.01 * pinning)
                towards = (gap > 0.0) == rising
                rise, run = (bends * pin + abs(gap), over * pin) if towards else (bends, over)
                slope = rise / run
                if stage == 0:
                    slope0 = slope
                    m = m0 + slope * dh
                    h += dh
                else:
                    m = m0 + 0.5 * (slope0 + slope) * dh
            m = min(max(m, -saturation), saturation)
        s[0], s[1] = position, m
    return p[0] * s[1]


@dataclass(frozen=True)
class JilesAtherton(Effect):
    """Torque size · M, with M of (6.4) driven by the position as field H, added to the drive (Fig. 6.8).

    dM/dH = (Man - M) / ((1 + c) (delta pinning - alpha (Man - M))) + c / (1 + c) dMan/dH
    Man = Ms (coth(He / a) - a / He),  He = H + alpha M,  delta = sign(dH)

    `pinning` is the paper's k · µ0. M and Ms have no dimension and all fields that of the position. The irreversible
    term is zero while delta (Man - M) < 0. Each step is divided and integrated by Heun's rule. A common factor of
    `ms` and 1/`size` changes nothing, and `alpha` is hardly seen far from saturation: both are constants.
    Source: (6.4), (6.5) of the paper; D. C. Jiles and D. L. Atherton, J. Magn. Magn. Mater. 61 (1986).
    """

    name = "jiles-atherton"
    family = "structure"
    site = Site.STRUCTURE
    cause = "hysteresis"
    symptom = "is a loop over the position with smooth flanks, independent of speed, whose size grows with the swing"
    n_state = 2
    step = _step

    size: float = size("torque at unit magnetisation, the paper's k_c", u=1, low=0.0)
    a: float = shape("field in which the anhysteretic curve bends", 0.44, y=1, low=1e-12)
    pinning: float = shape("field by which the magnetisation lags, the paper's k µ0", 2.2e-3, y=1, low=1e-12)
    c: float = shape("reversible part", 0.22, high=10.0, log=False)
    alpha: float = constant("field per magnetisation", 0.0, y=1)
    ms: float = constant("saturation magnetisation", 1.0)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return pinning from a small to a large part of the swing, on a bent and on a straight anhysteretic curve."""
        swing = max(view.position_peak, 1e-9)
        return [{"a": swing * bend, "pinning": swing * lag, "c": 0.2} for bend in (1.0, 30.0) for lag in (0.05, 0.3)]

    @classmethod
    def limits(cls, view: RecordView) -> dict[str, tuple[float, float]]:
        """Return fields of pinning beyond those within which friction turns."""
        return {"pinning": (max(MOST_GIVE * view.swing, 1e-12), math.inf)}
