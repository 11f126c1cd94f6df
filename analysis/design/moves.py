"""The move of an axis: the one of least torque that arrives in time and stays within the band that is learned."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from analysis.measurements.settling import BAND_RAD
from sim_backend.control.concentrated import arrival_sample, concentrated_move
from sim_backend.control.inversion import periodic_input
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel

Array = NDArray[np.float64]

MARGIN = 0.92
"""Part of the allowed time within which the reference arrives: the rest is for one sample of delay and the
remaining error."""

UNLEARNED = 0.2
"""Part of the settling band that a move may hold above the frequencies that are learned, as an angle."""

CONCENTRATIONS = (2.5, 3.0, 3.5, 4.0)
CHOP_DWELL_S = 0.1
"""Dwell of the chop that the torque is judged on: that of a 5 Hz chop."""


@dataclass(frozen=True)
class Move:
    """A move of a stroke: its samples and concentration, when it arrives, and its peak torque `peak_nm` in N m.

    `unlearned_rad` is the largest part of it above the frequencies that are learned.
    """

    n_samples: int
    concentration: float
    arrival_s: float
    peak_nm: float
    unlearned_rad: float


def design_move(plant: ModalModel, reach_rad: float, settling_s: float, cutoff_hz: float, rate_hz: float) -> Move:
    """Return the move of `reach_rad` in `settling_s` that takes the least peak torque (N m), sampled at `rate_hz`.

    Frequencies up to `cutoff_hz` are learned. Raises ConfigError when no move arrives in time within that band.
    """
    allowed = int(MARGIN * settling_s * rate_hz)
    dwell = max(round(CHOP_DWELL_S * rate_hz), 4 * allowed)
    found: list[Move] = []
    least = np.inf
    for concentration in CONCENTRATIONS:
        n = _longest(concentration, reach_rad, allowed)
        if n is None:
            continue
        move = _judged(plant, n, concentration, reach_rad, cutoff_hz, rate_hz, dwell)
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
    return min(found, key=lambda move: move.peak_nm)


@lru_cache(maxsize=256)
def _longest(concentration: float, reach_rad: float, allowed: int) -> int | None:
    """Return the largest number of samples with which a move arrives after `allowed` of them: a longer one is later."""
    lengths = [n for n in range(allowed, 2 * allowed) if concentration < 0.25 * n and n >= 4]
    late = bisect_right(
        lengths, allowed, key=lambda n: arrival_sample(concentrated_move(n, concentration), reach_rad, BAND_RAD)
    )
    return lengths[late - 1] if late else None


def _judged(
    plant: ModalModel, n: int, concentration: float, reach: float, cutoff_hz: float, rate_hz: float, dwell: int
) -> Move:
    way = concentrated_move(n, concentration)
    half = np.concatenate([way, np.ones(dwell - way.size)]) * reach
    motion = np.concatenate([half, reach - half])
    lines = np.fft.rfft(motion)
    lines[np.fft.rfftfreq(motion.size, 1.0 / rate_hz) <= cutoff_hz] = 0.0
    return Move(
        n,
        concentration,
        arrival_sample(way, reach, BAND_RAD) / rate_hz,
        float(np.max(np.abs(periodic_input(plant, motion, rate_hz)))),
        float(np.max(np.abs(np.fft.irfft(lines, motion.size)))),
    )
