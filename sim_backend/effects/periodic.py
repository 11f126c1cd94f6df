"""What repeats at even distances of the position, whether it is a torque or an error of the reading."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from sim_backend.effects.base import UNLISTED
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    angle = 6.283185307179586 * (position / p[2])
    return p[0] * math.cos(angle) + p[1] * math.sin(angle)


class Periodic:
    """Part of an effect of parameters cosine, sine and period: cosine · cos(2πx / period) + sine · sin(2πx / period).

    x is the position, in the same unit as the period.
    """

    beyond: ClassVar[Mapping[str, str]] = {"period": UNLISTED}
    step = _step

    @classmethod
    def limits(cls, view: RecordView) -> dict[str, tuple[float, float]]:
        """Return the distance within which the position mostly is: what seldom comes again is not seen to repeat."""
        return {"period": (1e-12, max(view.position_spread, 1e-12))}
