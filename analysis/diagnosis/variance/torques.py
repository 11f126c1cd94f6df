"""Many fits at once of a smooth floor with a random torque on top, each from a start of its own.

A likelihood of spectra has a maximum near every feature, so fits begin at many points and over several floors. One
takes microseconds of arithmetic and a millisecond of Python; as arrays all take hardly longer than one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.variance.spectrum import Spectrum
from sim_backend.linear import Array

_STEPS = 60
"""Steps of the search for the largest likelihood at most."""

_LONGEST, _GAINED = 1.0, 1e-6
"""The longest step of a parameter, all of which are logarithms, and the gain from which on a fit goes on."""

_TURN = 1e-4
"""Step of the differences that are slopes along the logarithms of centre and width."""

Start = tuple[int, float, float, bool, float]
"""Where the fit of a band starts: input, centre, width, whether its flanks are steep, and its power.

A centre of zero stays there: a low pass, half as wide as the width. An infinite width stays as well: white."""


def resonator(
    frequency_hz: Array, centre_hz: Array | float, width_hz: Array | float, steep: NDArray[np.bool_] | bool
) -> Array:
    """Return one-sided spectra (1/Hz) of resonators' outputs of unit variance, of the shape of all arguments together.

    Flanks fall with the square of the distance or, `steep`, with the fourth power of the frequency, as those of a mass
    on a spring under white noise do. Which of the two is real is unknown; the better one counts.
    """
    half = 0.5 * width_hz
    below, above = (frequency_hz - centre_hz) ** 2 + half**2, (frequency_hz + centre_hz) ** 2 + half**2
    falling = np.where(steep, 4.0 * (centre_hz**2 + half**2), below + above)
    return np.asarray(half / np.pi * falling / (below * above))


def free_of(centre_hz: float, width_hz: float) -> tuple[bool, bool]:
    """Tell whether centre and width of a start are fitted."""
    return 0.0 < centre_hz and not math.isinf(width_hz), not math.isinf(width_hz)


@dataclass(frozen=True)
class Torques:
    """Random torques, b of them: squared gains `gain` (b, n_y, k, points) from their inputs to the outputs.

    `numbers` (b, 3) are where each starts: the logarithms of power, centre and width, infinite for a low pass, whose
    centre is zero, and for what is white, whose width has no end. What is not `free` (b, 3) stays;
    `ends` are those of centres and widths.
    """

    gain: Array
    frequency_hz: Array
    rate_hz: float
    numbers: Array
    free: NDArray[np.bool_]
    steep: NDArray[np.bool_]
    ends: tuple[float, float]

    @classmethod
    def of(cls, gain: Array, frequency_hz: Array, rate_hz: float, starts: Sequence[Start], top_hz: float) -> Torques:
        """Return the torques that begin at `starts`; `gain` (n_y, n_u, k, points) is the plant's, squared.

        No centre and no width is beyond `top_hz`.
        """
        inputs, centre, width, steep, power = (np.array(values) for values in zip(*starts, strict=True))
        with np.errstate(divide="ignore"):
            numbers = np.log(np.stack([power, centre, width], axis=1))
        free = np.array([(True, *free_of(*start[1:3])) for start in starts])
        ends = math.log(0.1 * float(frequency_hz[0, 0])), math.log(top_hz)
        return cls(np.moveaxis(gain[:, inputs], 1, 0), frequency_hz, rate_hz, numbers, free, steep, ends)

    def places(self, numbers: Array, at: NDArray[np.int64]) -> tuple[Array, Array]:
        """Return centres and widths (b,) in hertz at some `numbers` of the torques `at`."""
        centre, width = np.exp(np.clip(numbers[:, 1:], *self.ends)).T
        low_pass, white = np.isneginf(self.numbers[at, 1]), np.isposinf(self.numbers[at, 2])
        centre = np.where(white, math.exp(self.ends[1]), np.where(low_pass, 0.0, centre))
        return centre, np.where(white, np.inf, width)

    def powers(self, numbers: Array, at: NDArray[np.int64]) -> Array:
        """Return what the torques `at` add to every output's spectrum at some `numbers`: (b, n_y, k)."""
        centre, width = self.places(numbers, at)
        white = np.isinf(width)
        narrow = np.where(white, 1.0, width)
        shape = (
            0.5
            * self.rate_hz
            * resonator(self.frequency_hz, centre[:, None, None], narrow[:, None, None], self.steep[at, None, None])
        )
        shape[white] = 1.0
        through = np.einsum("byks,bks->byk", self.gain[at], shape) / shape.shape[2]
        return np.asarray(np.exp(np.minimum(numbers[:, 0], 300.0))[:, None, None] * through)

    def slopes(self, numbers: Array, at: NDArray[np.int64], powers: Array) -> Array:
        """Return the derivatives (b, n_y, k, 3) of `powers` with respect to the numbers."""
        out = np.zeros((*powers.shape, 3))
        out[..., 0] = powers
        for i in (1, 2):
            free = self.free[at, i]
            there = numbers[free].copy()
            there[:, i] += _TURN
            out[free, ..., i] = (self.powers(there, at[free]) - powers[free]) / _TURN
        return out * self.free[at, None, None, :]


class Fits(NamedTuple):
    """What was fitted: floors (b, n_y, k), numbers (b, 3) with their variances, and minus the log-likelihoods (b,)."""

    floors: Array
    numbers: Array
    variances: Array
    loss: Array


class Fitting(NamedTuple):
    """A spectrum under floors exp(basis θ), θ (b, n_y · terms), with torques on top: parameters x (b, n_y · terms + 3).

    `basis` is (k, terms).
    """

    spectrum: Spectrum
    basis: Array
    torques: Torques

    def fitted(self, floor: Array) -> Fits:
        """Return the fits of largest likelihood by damped scoring, all floors beginning at `floor` (n_y, k).

        Each goes on until it gains nothing more.
        """
        theta = np.linalg.lstsq(self.basis, np.log(floor).T, rcond=None)[0].T.ravel()
        numbers = np.where(np.isfinite(self.torques.numbers), self.torques.numbers, 0.0)
        x = np.concatenate([np.tile(theta, (numbers.shape[0], 1)), numbers], axis=1)
        going = every = np.arange(x.shape[0])
        powers = self.torques.powers(numbers, every)
        loss, damping = self.loss(x, powers), np.full(x.shape[0], 1e-3)
        for _ in range(_STEPS):
            information, gradient = self.normal(x[going], going, powers[going])
            own = np.einsum("bii->bi", information)
            lift = damping[going, None] * own + 1e-12 * np.maximum(own.max(axis=1, keepdims=True), 1.0)
            solved = np.linalg.solve(information + lift[:, :, None] * np.eye(x.shape[1]), gradient[:, :, None])
            there = x[going] + np.clip(solved[:, :, 0], -_LONGEST, _LONGEST)
            then = self.torques.powers(there[:, -3:], going)
            after = self.loss(there, then)
            better = after < loss[going]
            gained = np.where(better, loss[going] - after, np.inf)
            won = going[better]
            x[won], powers[won], loss[won] = there[better], then[better], after[better]
            damping[going] *= np.where(better, 0.2, 10.0)
            going = going[(gained >= _GAINED) & (damping[going] <= 1e8)]
            if not going.size:
                break
        covariance = np.linalg.pinv(self.normal(x, every, powers)[0], rcond=1e-12)
        return Fits(self.floors(x), x[:, -3:], np.einsum("bii->bi", covariance)[:, -3:], loss)

    def floors(self, x: Array) -> Array:
        """Return the floors (b, n_y, k)."""
        theta = x[:, :-3].reshape(x.shape[0], -1, self.basis.shape[1])
        return np.asarray(np.exp(np.clip(theta @ self.basis.T, -700.0, 700.0)))

    def loss(self, x: Array, powers: Array) -> Array:
        """Return minus the log-likelihoods (b,) of torques that add `powers` (b, n_y, k) to their floors."""
        model = self.floors(x) + powers
        return 0.5 * np.sum(self.spectrum.count * (np.log(model) + self.spectrum.power / model), axis=(1, 2))

    def normal(self, x: Array, at: NDArray[np.int64], powers: Array) -> tuple[Array, Array]:
        """Return information (b, p, p) and minus the gradient of the loss (b, p) of torques `at`, which add `powers`.

        No output sees another's floor: of the floors' part only the blocks of each output are not zero.
        """
        floors = self.floors(x)
        model, terms = floors + powers, self.basis.shape[1]
        part = floors / model  # d ln(model) / dθ is this much of the basis
        along = self.torques.slopes(x[:, -3:], at, powers) / model[..., None]
        weight = 0.5 * self.spectrum.count
        missed = weight * (self.spectrum.power / model - 1.0)
        squares = (self.basis[:, :, None] * self.basis[:, None, :]).reshape(self.basis.shape[0], -1)
        blocks = ((weight * part**2) @ squares).reshape(*part.shape[:2], terms, terms)
        across = self.basis.T @ ((weight * part)[..., None] * along)
        n = part.shape[1] * terms
        information = np.zeros((x.shape[0], n + 3, n + 3))
        for o in range(part.shape[1]):
            here = slice(o * terms, (o + 1) * terms)
            information[:, here, here] = blocks[:, o]
            information[:, here, n:] = across[:, o]
            information[:, n:, here] = across[:, o].transpose(0, 2, 1)
        flat = along.reshape(x.shape[0], -1, 3)
        weighted = flat * np.broadcast_to(weight, part.shape).reshape(x.shape[0], -1, 1)
        information[:, n:, n:] = weighted.transpose(0, 2, 1) @ flat
        slopes = np.concatenate(
            [((missed * part) @ self.basis).reshape(x.shape[0], -1), np.einsum("byk,bykq->bq", missed, along)], axis=1
        )
        return information, slopes
