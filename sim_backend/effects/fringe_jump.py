"""Fringe jump: an interferometer loses count when the motion is faster than it can follow."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, shape, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView

_PITCH = 0.05
"""Relative distance of the limits that are tried."""


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    # s[0] fringes miscounted so far, s[1] is 1 from a loss until the motion is slow again
    if abs(rate) > p[1] and s[1] == 0.0:
        s[0] -= 1.0 if rate > 0.0 else -1.0
        s[1] = 1.0
    elif abs(rate) < 0.5 * p[1]:
        s[1] = 0.0
    return p[0] * s[0]


@dataclass(frozen=True)
class FringeJump(Effect):
    """Each time the rate goes beyond a limit the count misses one fringe and the reading stays behind by it.

    The counter follows again once the rate has fallen below half the limit, so that a noisy rate loses one fringe and
    not many. Motion to and fro loses and regains; the error is a whole number of fringes at all times.
    """

    name = "fringe-jump"
    family = "sensor"
    site = Site.READING
    symptom = "is a staircase of equal steps, each in the fastest part of a motion"
    n_state = 2
    step = _step

    fringe: float = size("reading of one fringe", y=1)
    rate_limit: float = shape(
        "rate beyond which a fringe is missed", 1.0, y=1, s=-1, low=1e-12, spread=0.4, grain=_PITCH / 2.0
    )

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return limits below the fastest motion of the record, down to a third of it.

        Which motions are too fast changes with every few per cent of the limit, and a descent cannot follow that.
        """
        return [{"rate_limit": max(view.rate_peak * (1.0 - _PITCH) ** (k + 0.5), 1e-12)} for k in range(20)]
