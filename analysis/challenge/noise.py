"""Coloured measurement noise with an exact inverse: white noise through a ladder of poles and zeros."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Noise:
    """Noise H(z) e of one reading, e white of standard deviation `std`; H has first tap 1, poles and zeros in z.

    H and its inverse are stable, so `whiten` turns the noise back into white noise of unit variance.
    """

    std: float
    poles: tuple[float, ...]
    zeros: tuple[float, ...]

    def coefficients(self) -> tuple[Array, Array]:
        """Return numerator (zeros + 1,) and denominator (poles + 1,) of H, highest power of z first."""
        return np.atleast_1d(np.poly(self.zeros)), np.atleast_1d(np.poly(self.poles))

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        """Return stationary noise (n,): a first stretch, long against the slowest pole, is thrown away."""
        numerator, denominator = self.coefficients()
        lead = int(8.0 / (1.0 - max((0.0, *self.poles)))) + 1
        return np.asarray(self.std * scipy.signal.lfilter(numerator, denominator, rng.standard_normal(lead + n))[lead:])

    def whiten(self, values: Array) -> Array:
        """Return `values` (n, k) through the inverse of H, over `std`."""
        numerator, denominator = self.coefficients()
        return np.asarray(scipy.signal.lfilter(denominator, numerator, values, axis=0) / self.std)

    def density(self, frequency_hz: Array, rate_hz: float) -> Array:
        """Return the spectrum (n_f,) at `frequency_hz`, over that of white noise of unit variance per sample."""
        numerator, denominator = self.coefficients()
        _, response = scipy.signal.freqz(numerator, denominator, worN=frequency_hz, fs=rate_hz)
        return np.asarray(self.std**2 * np.abs(response) ** 2)


def draw_noise(rng: np.random.Generator, std: float, rate_hz: float) -> Noise:
    """Return noise that is white above a corner drawn at 5–50 Hz and rises towards 0.2–1 Hz below it.

    Each rung of the ladder is a pole at p and a zero at √10 p, which makes an average slope of 1/f over a decade.
    """
    corner_hz = 10.0 ** rng.uniform(np.log10(5.0), np.log10(50.0))
    rungs = int(rng.integers(1, 3))
    pole_hz = [corner_hz / 10.0**0.5 / 10.0**k for k in range(rungs)]
    pole_hz = [max(f, 0.2) for f in pole_hz]
    poles = tuple(float(np.exp(-2.0 * np.pi * f / rate_hz)) for f in pole_hz)
    zeros = tuple(float(np.exp(-2.0 * np.pi * f * 10.0**0.5 / rate_hz)) for f in pole_hz)
    return Noise(std, poles, zeros)
