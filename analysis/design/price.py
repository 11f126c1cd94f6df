"""What a fast move costs: power and peak current of a chop against the time in which its moves arrive."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.design.moves import CHOP_DWELL_S, Move, design_move, fits_into
from campaigns.strategies.design import Design
from campaigns.strategies.designed import feedforward_of, move_over
from campaigns.strategies.overload import dissipated_w
from sim_backend.bench import Limits
from sim_backend.control.chop import Chop
from sim_backend.errors import ConfigError

Array = NDArray[np.float64]

CUTOFFS_HZ = (400.0, 500.0, 600.0, 700.0, 800.0, 1000.0, 1200.0, 1500.0)
"""Bands that may be learned, in Hz: from the narrowest that a move fits into, the one that learns most surely."""

TIMES_S = (4e-3, 4.5e-3, 5e-3, 5.5e-3, 6e-3, 7e-3, 8e-3, 10e-3, 12e-3, 16e-3, 24e-3, 32e-3)
"""Times allowed for a move, along the curve."""

PAPER = {"theta_x": (32e-3, 0.116, 2.75), "theta_y": (5.6e-3, 0.116, 2.75)}
"""What the paper achieved: settling in s, power in W, peak current in A; Table 6.6 has one power and one current."""


@dataclass(frozen=True)
class Price:
    """A move with the band that it needs, and what a 5 Hz chop of its stroke then requires of the coils.

    `power_w` is NaN where the bench does not say what its coils dissipate. `motion_rad` and `drive_nm` are one period.
    """

    allowed_s: float
    move: Move
    cutoff_hz: float
    power_w: float
    peak_a: float
    motion_rad: Array
    drive_nm: Array


def price_of(
    design: Design,
    dof: str,
    reach_rad: float,
    allowed_s: float,
    limits: Limits,
    column: int,
    widest_hz: float = CUTOFFS_HZ[-1],
) -> Price:
    """Return the move of stroke `reach_rad` within `allowed_s` and its price; ConfigError when there is none.

    `column` is the axis's in the bench's `limits`, `widest_hz` the band that may be learned.
    """
    rate = design.rate_hz
    move = design_move(design.axis(dof), reach_rad, allowed_s, widest_hz, rate)
    # what lies above the narrowest band that the move fits into is best left unlearned
    cutoff_hz = next(f for f in CUTOFFS_HZ if fits_into(move, reach_rad, f, rate))
    chop = Chop((reach_rad, 0.0), max(round(CHOP_DWELL_S * rate), 2 * move.n_samples), rate)
    motion = move_over(chop, lambda _: move.n_samples, move.concentration, dof)
    drive = feedforward_of(design, dof, motion, "learned")
    current = np.abs(limits.to_current[:, column])
    rms = float(np.sqrt(np.mean(drive**2)))
    power = float("nan") if limits.coil is None else dissipated_w(current * rms, limits.coil)
    return Price(allowed_s, move, cutoff_hz, power, float(np.max(np.abs(drive)) * current.max()), motion, drive)


def prices_of(
    design: Design, dof: str, reach_rad: float, allowed_s: float, limits: Limits, column: int
) -> Iterator[Price]:
    """Yield the move of least bandwidth, then those that fit into ever narrower bands; raises as `price_of`."""
    last: tuple[int, float] | None = None
    for widest_hz in reversed(CUTOFFS_HZ):
        try:
            one = price_of(design, dof, reach_rad, allowed_s, limits, column, widest_hz)
        except ConfigError:
            if last is None:
                raise
            return
        if (one.move.n_samples, one.move.concentration) != last:
            last = one.move.n_samples, one.move.concentration
            yield one


def price_curve(design: Design, dof: str, reach_rad: float, limits: Limits, column: int) -> tuple[Price, ...]:
    """Return the prices of all TIMES_S in which a move is possible, the fastest first; raises as `price_of`."""
    found: list[Price] = []
    for allowed_s in TIMES_S:
        try:
            found.append(price_of(design, dof, reach_rad, allowed_s, limits, column))
        except ConfigError:
            if allowed_s == TIMES_S[-1]:
                raise
    return tuple(found)


def affordable(curve: Sequence[Price], most_w: float) -> Price:
    """Return the fastest point of a curve that dissipates `most_w` at most; raises ConfigError where none does."""
    within = [one for one in curve if one.power_w <= most_w]
    if within:
        return within[0]
    least = min(one.power_w for one in curve)
    if np.isnan(least):
        raise ConfigError("the bench does not say what its coils dissipate; leave --max-power out")
    raise ConfigError(
        f"a chop of this stroke dissipates {least:.3g} W or more, the limit is {most_w:g} W; allow more "
        "or give a smaller stroke"
    )
