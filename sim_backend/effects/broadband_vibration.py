"""Broadband vibration: a random disturbance of the bench within a band."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_backend.effects.base import Aux, Effect, Site, shape, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    # complex first-order filter dz/dt = (-decay + j omega) z + w, with w held: s[0] + j s[1]
    omega, decay = 6.283185307179586 * p[1], 3.141592653589793 * p[2]
    square = omega * omega + decay * decay
    shrink = math.exp(-decay * dt_s)
    turn_re, turn_im = shrink * math.cos(omega * dt_s), shrink * math.sin(omega * dt_s)
    # (exp(lambda dt) - 1) / lambda with lambda = -decay + j omega
    gain_re = ((turn_re - 1.0) * -decay + turn_im * omega) / square
    gain_im = (turn_im * -decay - (turn_re - 1.0) * omega) / square
    now_re, now_im = s[0], s[1]
    s[0] = turn_re * now_re - turn_im * now_im + gain_re * aux
    s[1] = turn_re * now_im + turn_im * now_re + gain_im * aux
    # variance of Re z under white noise of unit density
    variance = 0.25 * (1.0 / decay + decay / square)
    return p[0] * now_re / math.sqrt(variance)


@dataclass(frozen=True)
class BroadbandVibration(Effect):
    """Random torque of standard deviation `rms`, white noise through a resonator of the given band.

    The spectrum is half as high at centre_hz ± bandwidth_hz / 2. For a centre far below the bandwidth it is a low-pass.
    The standard deviation holds for a band well below the sample rate: a share (pi f / f_s)² / 3 is missing at f.
    """

    name = "broadband-vibration"
    family = "surroundings"
    site = Site.STRUCTURE
    symptom = "is random within a band of frequencies, whatever is played"
    aux = Aux.EXOGENOUS
    n_state = 2
    step = _step

    rms: float = size("standard deviation of the torque", u=1, low=0.0)
    centre_hz: float = shape("centre of the band", 50.0, s=-1, low=1e-3)
    bandwidth_hz: float = shape("width of the band at half power", 20.0, s=-1, low=1e-3)

    def drawn_std(self, rate_hz: float) -> float:
        """Return that of white noise of unit two-sided density, held over each sample."""
        return math.sqrt(rate_hz)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return bands about the strongest lines of the residual."""
        lines = [f for f in view.residual_lines_hz(3) if f > 0.0]
        return [{"centre_hz": f, "bandwidth_hz": f * part} for f in lines for part in (0.1, 0.5)]
