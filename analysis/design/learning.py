"""The learning filter of an axis, and how surely learning converges: from models and from the measured response.

Every period the error shrinks by |Q (1 - k z^lead S_p L)|, frequency by frequency. Where that stays below one for every
plant within the uncertainty and every gain, the error falls from each period to the next.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.recorded.sweep import Sweep
from sim_backend.control.blocks import DiscreteFilter
from sim_backend.control.inversion import fitted_inverse, inverse_poles
from sim_backend.control.repetitive import process_sensitivity, q_response, q_taps
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel, discretise

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

LARGEST_FACTOR = 0.5
"""The part of an error that may remain after a period, on every plant and at every measured line within 2σ."""

SURE_FACTOR = 0.9
"""What it may leave where no feedback keeps LARGEST_FACTOR, as around a sharp mode that is not known well: the error
still falls from each period to the next, and a run is stopped where it does not."""

HALF_LENGTH_S = 0.006
"""Q filter: six milliseconds to either side, so that it falls within 80 Hz at its cut-off."""

LEAD_S = 0.001
TRUSTED, FADING = 1500.0, 2500.0
"""Up to where in Hz the inverse has to fit, and from where on it hardly matters: Q has long closed there."""

FULL = 3
"""Periods that learn with the whole error: by LARGEST_FACTOR an eighth of it remains."""

WAIT_S = 0.4
"""Time before learning begins: the ringing of a cryostat mode of 9 s⁻¹ falls to 3 % in it."""


@dataclass(frozen=True)
class LearningDesign:
    """The learning of one axis.

    `factor` (n_f,) at `frequency_hz` is by how much an error shrinks per period on the identified plant with gain 1,
    `worst` (n_f,) on the worst drawn one. `lines_hz`, `at_lines` and `at_lines_worst` are the same from the measured
    response and its 2σ bound, None where no sweep was given.
    """

    filter: DiscreteFilter
    lead_samples: int
    cutoff_hz: float
    half_length: int
    gains: tuple[float, ...]
    frequency_hz: Array
    factor: Array
    worst: Array
    lines_hz: Array | None
    at_lines: Array | None
    at_lines_worst: Array | None

    @property
    def largest(self) -> float:
        """The largest factor of all, drawn plants and measured lines included."""
        return float(max(self.worst.max(), 0.0 if self.at_lines_worst is None else self.at_lines_worst.max()))

    @property
    def taps(self) -> tuple[float, ...]:
        """The Q filter."""
        return q_taps(self.cutoff_hz, self.half_length, self.filter.rate_hz)


def averaging_gains(count: int) -> tuple[float, ...]:
    """Return gains that take the whole error FULL times and then average: 1, 1, 1, 1/2, 1/3 and so on.

    With gain 1/n the learned input becomes the mean of n noisy estimates, whose noise falls with the root of n.
    """
    full = min(FULL, count)
    return (*(1.0 for _ in range(full)), *(1.0 / n for n in range(2, count - full + 2)))


def design_learning(
    plants: list[ModalModel],
    controller: DiscreteFilter,
    grid_hz: Array,
    sweep: Sweep | None,
    periods: int,
    cutoff_hz: float,
) -> LearningDesign:
    """Return the learning around `controller` below `cutoff_hz`; the first plant is the identified one.

    `grid_hz` (n_f,) are the frequencies at which the error has to shrink. Raises ConfigError when it is not sure that
    the error shrinks to SURE_FACTOR per period or less.
    """
    rate = controller.rate_hz
    f = grid_hz[grid_hz >= 0.5]
    weight = np.where(f < TRUSTED, 1.0, np.where(f < FADING, 0.1, 0.01)) * np.sqrt(np.gradient(f) / f)
    lead, half = round(LEAD_S * rate), round(HALF_LENGTH_S * rate)
    nominal = discretise(plants[0], rate)
    closed = np.stack(
        [
            process_sensitivity(discretise(p, rate).frequency_response(f)[:, 0, 0], controller.frequency_response(f))
            for p in plants
        ]
    )
    made = fitted_inverse(f, closed[0], weight, inverse_poles(nominal, controller), lead, rate)
    ahead = np.exp(2j * np.pi * f / rate * lead) * made.frequency_response(f)
    left = np.abs(1.0 - closed * ahead)
    lines = None if sweep is None else _at_lines(sweep, controller, made, lead)
    taps = q_taps(cutoff_hz, half, rate)
    q = np.abs(q_response(taps, f, rate))
    worst = (q * left).max(axis=0)
    at = [None] * 3 if lines is None else [lines[0], *(np.abs(q_response(taps, lines[0], rate)) * x for x in lines[1:])]
    found = LearningDesign(
        made, lead, cutoff_hz, half, averaging_gains(periods), f, q * left[0], worst, at[0], at[1], at[2]
    )
    if not found.largest <= SURE_FACTOR:
        raise ConfigError(
            f"learning below {cutoff_hz:g} Hz: a period may leave {found.largest:.2f} of an error, the limit is "
            f"{SURE_FACTOR}; identify the axis better or state a smaller tolerance"
        )
    return found


def _at_lines(sweep: Sweep, controller: DiscreteFilter, made: DiscreteFilter, lead: int) -> tuple[Array, Array, Array]:
    """|1 - z^lead S_p L| of the measured response, and its bound where the response errs by two standard deviations.

    S_p = P/(1 + P C) changes by dP/(1 + P C)².
    """
    f, rate = sweep.frequency_hz, controller.rate_hz
    k = controller.frequency_response(f)
    ahead = np.exp(2j * np.pi * f / rate * lead) * made.frequency_response(f)
    left = np.abs(1.0 - process_sensitivity(sweep.response, k) * ahead)
    spread = 2.0 * np.sqrt(0.5 * sweep.variance) * np.abs(ahead / (1.0 + sweep.response * k) ** 2)
    return f, left, left + spread
