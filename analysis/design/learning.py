"""The learning filter of an axis, and how surely learning converges: from models and from the measured response.

Every period the error shrinks by |Q (1 - k z^lead S_p L)|, frequency by frequency. Where that stays below one for every
plant within the uncertainty and every gain, the error falls from each period to the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from analysis.design.expected import Expected, Learned, Motion
from analysis.design.uncertainty import MOST
from analysis.measurements.settling import BAND_RAD
from analysis.recorded.sweep import Sweep
from campaigns.strategies.watch import FLOOR_RAD, STRAY_RAD
from sim_backend.control.blocks import DiscreteFilter
from sim_backend.control.inversion import fitted_inverse, inverse_poles
from sim_backend.control.repetitive import process_sensitivity, q_response, q_taps
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel, discretise

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

LARGEST_FACTOR = 0.5
"""The part of an error that a period with gain 1 may always leave: what is promised to whoever watches it."""

LEFT = 0.6
"""Part of the settling band that may be left on any plant after learning: the rest is for the noise of the mean cycle.
"""

ENOUGH = 0.99
"""Part of the plants that meet what is asked, from which on nothing better is looked for."""

LEAST = 0.5
"""Part of the plants that must settle, or the design is refused."""

OFF = 0.25
"""How far a real error may be off the predicted one, relatively: plants have neither hysteresis nor noise. Assumed."""

QUICK = 2
"""Periods after which no plant should stray any more: the bench is stopped where it does (`strategies.watch`)."""

HALF_LENGTH_S = 0.006
"""Q filter: six milliseconds to either side, so that it falls within 80 Hz at its cut-off."""

LEAD_S = 0.001
TRUSTED, FADING = 1500.0, 2500.0
"""Up to where in Hz the inverse has to fit, and from where on it hardly matters: Q has long closed there."""

QUICK_GAIN, STEADY_GAINS = 0.9, (0.5, 0.6)
"""Parts of the error that are learned from in the first QUICK periods, and may be in the next. Where a sharp mode is
not where the model has it, or the bench late, the inverse is too large or turned, and the whole of it makes the error
grow there: for two periods, which take most of a large error elsewhere, but not for long. Calibrated on drawn benches
of one seed (2026-11-28): one of 120 strayed with 0.8, none of 130 with 0.9."""

FULL = 6.0
"""Periods that learn with the steady gain, times this gain. What is left of the beginning, half a milliradian on a
bench that is late, then only falls as one over the number of periods."""

WAIT_S = 0.2
"""Time before learning begins, a period at least: until then a bench that is late strays after its steps, and the
ringing of a cryostat mode of 9 s⁻¹ falls to a sixth in it."""


@dataclass(frozen=True)
class LearningDesign:
    """The learning of one axis.

    `factor` (n_f,) at `frequency_hz` is by how much an error shrinks per period on the identified plant with the steady
    gain, `worst` (n_f,) on the worst drawn one. `lines_hz`, `at_lines` and `at_lines_worst` are the same from the
    measured response and its 2σ bound, None where no sweep was given. `expected` are the errors of a chop on every
    plant, `grown` the part of an error that all periods together leave at any frequency, on most plants.
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
    expected: Expected
    grown: float

    @property
    def largest(self) -> float:
        """The largest factor of all, drawn plants and measured lines included."""
        return float(max(self.worst.max(), 0.0 if self.at_lines_worst is None else self.at_lines_worst.max()))

    @property
    def shrinks_to(self) -> float:
        """The part of a large error (rms) that a period with gain 1 leaves at most, as far as smaller gains tell.

        |1 - g x| is convex in the gain g, so that a period with any smaller gain g leaves 1 - g (1 - this) at most.
        """
        return max(1.0 - (1.0 - self.expected.shrinks_to(FLOOR_RAD)) / self.gains[0], LARGEST_FACTOR)

    @property
    def refusal(self) -> str:
        """Why it must not be played; empty where it may."""
        fix = "identify the axis better or state a smaller tolerance"
        swept = 0.0 if self.at_lines_worst is None else float(self.at_lines_worst.max())
        if not swept <= 1.0:
            return f"a period may leave {swept:.2f} of an error by the swept response, the limit is 1; {fix}"
        if not self.grown <= 1.0:
            return f"all periods may leave {self.grown:.2f} of an error together, the limit is 1; {fix}"
        if not self.meets >= LEAST:
            return (
                f"{100.0 * self.meets:.0f} % of the plants within the uncertainty settle, the limit is "
                f"{100.0 * LEAST:.0f} %; {fix}"
            )
        return ""

    @property
    def meets(self) -> float:
        """The part of the plants that are near enough in the end, and do not stray for longer than QUICK periods."""
        settles = self.expected.after_rad[-1] <= LEFT * BAND_RAD
        return float(np.mean(settles & (self._strays_rad <= STRAY_RAD)))

    @property
    def _strays_rad(self) -> Array:
        """How far each plant (n,) is off after its steps, from the period on in which none should stray any more."""
        return np.asarray(self.expected.after_rad[QUICK:].max(axis=0))

    @property
    def likely(self) -> float:
        """The part of the plants that is likely to meet, where real errors differ from the predicted ones by OFF."""
        nearest = np.maximum(self.expected.after_rad[-1] / (LEFT * BAND_RAD), self._strays_rad / STRAY_RAD)
        return float(np.mean(np.clip(0.5 + (1.0 - nearest) / (2.0 * OFF), 0.0, 1.0)))

    def rank(self) -> tuple[bool, float]:
        """Return what a learning is chosen by: it may be played, and most plants are likely to meet what is asked."""
        return bool(self.refusal), -self.likely

    @property
    def taps(self) -> tuple[float, ...]:
        """The Q filter."""
        return q_taps(self.cutoff_hz, self.half_length, self.filter.rate_hz)


def averaging_gains(count: int, steady: float = 1.0, quick: float = 1.0) -> tuple[float, ...]:
    """Return gains that take a part of the error some times and then average: 1, …, 1, 1/2, 1/3 and so on.

    The first QUICK of them are `quick`, or fewer where there are no more than twice as many. With gain 1/n the learned
    input becomes the mean of n noisy estimates, whose noise falls with the root of n. An input learned with a gain g is
    the mean of 1/g of them already.
    """
    early = min(QUICK, count // 2)
    full = min(round(FULL / steady), count) - early
    averaging = (1.0 / (1.0 / steady + n) for n in range(1, count - early - full + 1))
    return (*(quick for _ in range(early)), *(steady for _ in range(full)), *averaging)


def design_learning(
    plants: list[ModalModel],
    controller: DiscreteFilter,
    grid_hz: Array,
    sweep: Sweep | None,
    periods: int,
    cutoffs_hz: Sequence[float],
    motion: Motion,
) -> LearningDesign:
    """Return the learning around `controller` that leaves least of the chop `motion`; the first plant is identified.

    `grid_hz` (n_f,) are the frequencies at which the error must not grow, `cutoffs_hz` the bands that may be learned,
    which are tried with all steady gains. Raises ConfigError when an error may grow on too many plants, or too few
    settle.
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
    # nearest to the inverse of all plants at once: where they differ it is small, and late by their mean delay
    made = fitted_inverse(f, closed, weight, inverse_poles(nominal, controller), lead, rate)
    learned = Learned(plants, controller, made, lead, motion)
    ahead = closed * (np.exp(2j * np.pi * f / rate * lead) * made.frequency_response(f))
    found: list[LearningDesign] = []
    for cutoff_hz, steady in product(cutoffs_hz, STEADY_GAINS):
        one = _Tried(made, lead, cutoff_hz, half, steady, periods)
        at = (None, None, None) if sweep is None else _at_lines(sweep, controller, one)
        found.append(one.design(f, ahead, at, learned))
    best = min(found, key=LearningDesign.rank)
    if best.refusal:
        raise ConfigError(f"learning below {best.cutoff_hz:g} Hz: {best.refusal}")
    return best


@dataclass(frozen=True)
class _Tried:
    """A learning filter in a band, with a steady gain and so many periods."""

    filter: DiscreteFilter
    lead_samples: int
    cutoff_hz: float
    half_length: int
    steady: float
    periods: int

    @cached_property
    def gains(self) -> tuple[float, ...]:
        """The gain of each period."""
        return averaging_gains(self.periods, self.steady, QUICK_GAIN)

    @cached_property
    def taps(self) -> tuple[float, ...]:
        """The low pass."""
        return q_taps(self.cutoff_hz, self.half_length, self.filter.rate_hz)

    def q(self, frequency_hz: Array) -> Array:
        """Return the magnitude (n_f,) of the low pass."""
        return np.abs(q_response(self.taps, frequency_hz, self.filter.rate_hz))

    def design(
        self, f: Array, ahead: ComplexArray, at: tuple[Array | None, Array | None, Array | None], learned: Learned
    ) -> LearningDesign:
        """Return it with what it does to plants of which z^lead S_p L is `ahead` (n, n_f), and `at` measured lines."""
        q = self.q(f)
        left = {gain: q * np.abs(1.0 - gain * ahead) for gain in set(self.gains)}
        steady = left[self.steady]
        whole = np.ones_like(steady)
        for gain in self.gains:
            whole *= left[gain]
        return LearningDesign(
            filter=self.filter,
            lead_samples=self.lead_samples,
            cutoff_hz=self.cutoff_hz,
            half_length=self.half_length,
            gains=self.gains,
            frequency_hz=f,
            factor=steady[0],
            worst=steady.max(axis=0),
            lines_hz=at[0],
            at_lines=at[1],
            at_lines_worst=at[2],
            expected=learned.expected(self.taps, self.gains),
            grown=float(np.quantile(whole.max(axis=-1), MOST)),
        )


def _at_lines(sweep: Sweep, controller: DiscreteFilter, tried: _Tried) -> tuple[Array, Array, Array]:
    """The lines, |Q (1 - gain z^lead S_p L)| of the measured response, and its bound two standard deviations away.

    S_p = P/(1 + P C) changes by dP/(1 + P C)².
    """
    f, rate, gain = sweep.frequency_hz, controller.rate_hz, tried.steady
    k, q = controller.frequency_response(f), tried.q(sweep.frequency_hz)
    ahead = np.exp(2j * np.pi * f / rate * tried.lead_samples) * tried.filter.frequency_response(f)
    left = q * np.abs(1.0 - gain * process_sensitivity(sweep.response, k) * ahead)
    spread = 2.0 * np.sqrt(0.5 * sweep.variance) * np.abs(ahead / (1.0 + sweep.response * k) ** 2)
    return f, left, left + gain * q * spread
