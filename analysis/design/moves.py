"""The move of an axis: it arrives in time, stays within the band that is learned, and takes little power.

Of those it is the one of least bandwidth. What a move holds at a sharp mode is what learning has to take out there, on
a bench whose mode is not where the model has it.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from analysis.measurements.settling import BAND_RAD
from sim_backend.control.concentrated import arrival_sample, bandwidth_hz, concentrated_move
from sim_backend.control.inversion import periodic_input
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel

Array = NDArray[np.float64]

MARGIN = 0.98
"""Part of the allowed time within which the reference arrives: the rest is a sample for the remaining error. What a
bench is late, learning takes out. Was 0.92 until 2026-11-29: the settling of 1,000 drawn benches had used none of it,
and a longer move takes a fifth less power and holds half as much at 490 Hz."""

UNLEARNED = 0.2
"""Part of the settling band that a move may hold above the frequencies that are learned, as an angle."""

CONCENTRATIONS = tuple(k / 10 for k in range(25, 41))

DEARER = 1.025
"""By how much more torque (rms) than the least a move may take, for less bandwidth: 5 % of power."""

CHOP_DWELL_S = 0.1
"""Dwell of the chop that the torque is judged on: that of a 5 Hz chop."""


@dataclass(frozen=True)
class Move:
    """A move of a stroke: its samples and concentration, when it arrives, and its torque in N m.

    `peak_nm` is its largest, `rms_nm` its root mean square in a chop. `unlearned_rad` is the largest part of the move
    above the frequencies that are learned.
    """

    n_samples: int
    concentration: float
    arrival_s: float
    peak_nm: float
    rms_nm: float
    unlearned_rad: float


def design_move(plant: ModalModel, reach_rad: float, settling_s: float, cutoff_hz: float, rate_hz: float) -> Move:
    """Return the move of `reach_rad` in `settling_s` of least bandwidth among those of little torque.

    It is sampled at `rate_hz`. Frequencies up to `cutoff_hz` are learned. Raises ConfigError when no move arrives in
    time within that band.
    """
    allowed = int(MARGIN * settling_s * rate_hz)
    found: list[Move] = []
    least = np.inf
    for concentration in CONCENTRATIONS:
        n = _longest(concentration, reach_rad, allowed)
        if n is None:
            continue
        move = _judged(plant, n, concentration, reach_rad, cutoff_hz, rate_hz)
        least = min(least, move.unlearned_rad)
        if move.unlearned_rad <= UNLEARNED * BAND_RAD:
            found.append(move)
    if not np.isfinite(least):
        raise ConfigError(
            f"move of {1e3 * reach_rad:g} mrad in {1e3 * settling_s:g} ms: {allowed} samples at {rate_hz:g} Hz are too "
            "few for a smooth move; allow more time"
        )
    if not found:
        raise ConfigError(
            f"move of {1e3 * reach_rad:g} mrad in {1e3 * settling_s:g} ms: {1e6 * least:.3g} µrad of it or more lie "
            f"above {cutoff_hz:g} Hz, where nothing is learned, the limit is {1e6 * UNLEARNED * BAND_RAD:.2g} µrad; "
            "allow more time"
        )
    dearest = DEARER * min(move.rms_nm for move in found)
    return min(
        (m for m in found if m.rms_nm <= dearest), key=lambda m: bandwidth_hz(m.n_samples, m.concentration, rate_hz)
    )


def fits_into(move: Move, reach_rad: float, cutoff_hz: float, rate_hz: float) -> bool:
    """Tell whether a band up to `cutoff_hz` holds all of a move of `reach_rad` that has to be learned."""
    motion = _chop(concentrated_move(move.n_samples, move.concentration), reach_rad, rate_hz)
    return _unlearned_rad(motion, cutoff_hz, rate_hz) <= UNLEARNED * BAND_RAD


@lru_cache(maxsize=256)
def _longest(concentration: float, reach_rad: float, allowed: int) -> int | None:
    """Return the largest number of samples with which a move arrives after `allowed` of them: a longer one is later."""
    lengths = [n for n in range(allowed, 2 * allowed) if concentration < 0.25 * n and n >= 4]
    late = bisect_right(
        lengths, allowed, key=lambda n: arrival_sample(concentrated_move(n, concentration), reach_rad, BAND_RAD)
    )
    return lengths[late - 1] if late else None


def _judged(
    plant: ModalModel, n: int, concentration: float, stroke_rad: float, cutoff_hz: float, rate_hz: float
) -> Move:
    way = concentrated_move(n, concentration)
    motion = _chop(way, stroke_rad, rate_hz)
    torque = periodic_input(plant, motion, rate_hz)
    return Move(
        n,
        concentration,
        arrival_sample(way, stroke_rad, BAND_RAD) / rate_hz,
        float(np.max(np.abs(torque))),
        float(np.sqrt(np.mean(torque**2))),
        _unlearned_rad(motion, cutoff_hz, rate_hz),
    )


def _chop(way: Array, stroke_rad: float, rate_hz: float) -> Array:
    """Return one period (samples,) of a chop of `stroke_rad` whose moves follow `way` (n,)."""
    dwell = max(round(CHOP_DWELL_S * rate_hz), 4 * way.size)
    half = np.concatenate([way, np.ones(dwell - way.size)]) * stroke_rad
    return np.concatenate([half, stroke_rad - half])


def _unlearned_rad(motion: Array, cutoff_hz: float, rate_hz: float) -> float:
    """Return the largest part of a period of `motion` (n,) above `cutoff_hz`."""
    lines = np.fft.rfft(motion)
    lines[np.fft.rfftfreq(motion.size, 1.0 / rate_hz) <= cutoff_hz] = 0.0
    return float(np.max(np.abs(np.fft.irfft(lines, motion.size))))
