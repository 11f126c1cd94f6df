"""Vibration line: a pump or the mains disturbs the bench at one frequency."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from sim_backend.effects.base import UNKNOWN_RUN, Effect, Site, shape, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    # s[0] is the phase in periods, kept within one so that it stays exact in long runs
    angle = 6.283185307179586 * s[0]
    s[0] = (s[0] + p[2] * dt_s) % 1.0
    return p[0] * math.cos(angle) + p[1] * math.sin(angle)


_PERIODS = 20.0

_BANDS = 512
"""Narrow surroundings: the noise of a band, or of an excited resonance, is no background to a line elsewhere."""


@dataclass(frozen=True)
class VibrationLine(Effect):
    """Torque cosine · cos(2π frequency_hz t) + sine · sin(2π frequency_hz t), t from the start of the run.

    A disturbance is not synchronised with the runs: where several were recorded, `runs` holds for each by how many
    periods the line is ahead of that of the first, middle against middle, and half of by how many seconds it is
    shorter. `ahead` is the phase, in periods, in which the run at hand begins. A model file holds the phase of the
    first run.
    """

    name = "vibration-line"
    family = "surroundings"
    site = Site.STRUCTURE
    symptom = "is a line at a fixed frequency, whatever is played"
    n_state = 1
    step = _step

    cosine: float = size("torque in phase with the start", u=1)
    sine: float = size("torque a quarter period later", u=1)
    frequency_hz: float = shape("frequency of the vibration", 50.0, s=-1, low=1e-9)
    runs: tuple[tuple[float, float], ...] = ()
    ahead: float = 0.0

    def in_run(self, run: int) -> Self:
        """Return the line with the phase that it begins the run with."""
        if not self.runs or run == UNKNOWN_RUN:
            return replace(self, runs=())
        turn, earlier_s = self.runs[run]
        return replace(self, ahead=(turn + earlier_s * self.frequency_hz) % 1.0)

    def own_frequency_hz(self) -> float:
        """Return the frequency of the line."""
        return self.frequency_hz

    def turned(self, periods: float) -> Self:
        """Return the line so many periods further on."""
        return replace(self, ahead=(self.ahead + periods) % 1.0)

    def chosen(self) -> int:
        """Return the number of phases beside that of the first run."""
        return max(len(self.runs) - 1, 0)

    def start(self) -> NDArray[np.float64]:
        """Return the phase before the first sample in periods, shape (1,)."""
        return np.array([self.ahead])

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return the strongest lines of the residual."""
        # fewer periods than this are drift: the noise down there is known from a handful of samples
        lowest = _PERIODS / view.duration_s
        return [{"frequency_hz": f} for f in view.residual_lines_hz(5, lowest, _BANDS) if f > lowest]

    @classmethod
    def given(cls, view: RecordView, shapes: dict[str, float]) -> dict[str, Any]:
        """Return how far the line is ahead in each run."""
        phases = view.line_phases(shapes["frequency_hz"])
        first, seconds = phases[0]
        return {"runs": tuple((phase - first, 0.5 * (seconds - own)) for phase, own in phases)}

    @classmethod
    def choices(cls, view: RecordView) -> int:
        """Return the number of bins that are compared: every frequency of the residual's spectrum.

        A phase that is chosen for a run as well counts as two.
        """
        return (view.residual.size // 2) * 2 ** max(len(view.ends) - 1, 0)
