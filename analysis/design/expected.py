"""What learning leaves of a chop's error, period by period, on every plant that the identified one may be.

A chop repeats, so that only multiples of its frequency matter. With S = 1/(1 + P C) and the feed-forward u of the
motion r the first error is S (r - P u). A period with gain g then takes the learned input from v to
Q (v + g z^lead L e), and the error to S (r - P u) - S P v. That the loop settles within each period is supposed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.design.uncertainty import MOST
from sim_backend.control.blocks import DiscreteFilter
from sim_backend.control.repetitive import process_sensitivity, q_response
from sim_backend.linear import ModalModel, discretise

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True)
class Motion:
    """One period of a chop, all (n,): `reference` (rad), feed-forward `drive` (N m) and where its steps are over."""

    reference: Array
    drive: Array
    after: NDArray[np.bool_]

    @classmethod
    def of(cls, reference: Array, drive: Array, step_samples: int) -> Motion:
        """Return the period of `reference` and `drive` (n,): two moves, half of it apart, of `step_samples` at most."""
        half = reference.size // 2
        return cls(reference, drive, np.arange(reference.size) % half >= step_samples)


@dataclass(frozen=True)
class Expected:
    """Errors before learning and after every period of it, on n plants.

    `rms_rad` is over a period, `after_rad` the largest after its steps, both (periods + 1, n).
    """

    rms_rad: Array
    after_rad: Array

    @property
    def left_rad(self) -> float:
        """The largest error after a step that is left at the end on MOST of the plants."""
        return float(np.quantile(self.after_rad[-1], MOST))

    def shrinks_to(self, above_rad: float) -> float:
        """Return which part of an error (rms) above `above_rad` a period leaves on MOST plants; 0 where none is."""
        before, after = self.rms_rad[:-1], self.rms_rad[1:]
        ratio = np.where(before > above_rad, after / np.maximum(before, above_rad), 0.0)
        return float(np.quantile(ratio.max(axis=0), MOST))


class Learned:
    """The responses that decide what is learned of a chop on every plant, which do not depend on the gains."""

    def __init__(
        self,
        plants: Sequence[ModalModel],
        controller: DiscreteFilter,
        learning: DiscreteFilter,
        lead: int,
        motion: Motion,
    ) -> None:
        rate, n = controller.rate_hz, motion.reference.size
        self._f = np.fft.rfftfreq(n, 1.0 / rate)
        # an integrator has no response at rest, and needs none: it holds the mean
        at = np.maximum(self._f, 1e-3 * self._f[1])
        responses = np.stack([discretise(plant, rate).frequency_response(at)[:, 0, 0] for plant in plants])
        self._process = process_sensitivity(responses, controller.frequency_response(at))
        wanted, driven = np.fft.rfft(motion.reference), np.fft.rfft(motion.drive)
        self._first = self._process * (wanted / responses - driven)
        self._ahead = np.exp(2j * np.pi * self._f / rate * lead) * learning.frequency_response(at)
        self._motion, self._rate = motion, rate

    def expected(self, taps: Sequence[float], gains: Sequence[float]) -> Expected:
        """Return the errors with the low pass `taps` and a period with each of `gains`."""
        q = q_response(taps, self._f, self._rate)
        learned, error = np.zeros_like(self._first), self._first
        rms, after = [], []
        for gain in (None, *gains):
            if gain is not None:
                learned = q * (learned + gain * self._ahead * error)
                error = self._first - self._process * learned
            course = np.fft.irfft(error, self._motion.reference.size, axis=-1)
            rms.append(np.sqrt(np.mean(course**2, axis=-1)))
            after.append(np.max(np.abs(course[:, self._motion.after]), axis=-1))
        return Expected(np.array(rms), np.array(after))
