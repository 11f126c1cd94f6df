"""Rounding to whole steps, whether of a command or of a reading."""

from __future__ import annotations

import math

from sim_backend.effects.compiled import compiled


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    # beyond 2^52 steps every float is a whole number of them, within its rounding
    if abs(signal) >= p[0] * 4503599627370496.0:
        return 0.0
    return p[0] * math.floor(signal / p[0] + 0.5) - signal


class Rounding:
    """Part of an effect of one parameter, the step size to whole multiples of which its signal is rounded."""

    step = _step
    whole = True
