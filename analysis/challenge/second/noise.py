"""Measurement noise of several slopes, by filters that can be run backwards."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

SLOPES = ("white", "1/f", "1/f^2", "hump")


@dataclass(frozen=True)
class Noise:
    """Noise of standard deviation `std` and of the colour numerator/denominator, white noise being 1/1."""

    slope: str
    std: float
    numerator: Array
    denominator: Array

    @cached_property
    def _gain(self) -> float:
        """Return the standard deviation that the filter makes of unit white noise."""
        frequency = np.linspace(0.0, np.pi, 8001)[1:]
        _, response = scipy.signal.freqz(self.numerator, self.denominator, worN=frequency)
        return float(np.sqrt(np.mean(np.abs(response) ** 2)))

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        """Return noise (n,); what the filter needs to come into swing is drawn before and left out."""
        before = 5000
        coloured = scipy.signal.lfilter(self.numerator, self.denominator, rng.standard_normal(n + before))
        return np.asarray(self.std / self._gain * coloured[before:])

    def whiten(self, x: Array) -> Array:
        """Return x (n, …) in units of the white noise that makes this noise."""
        return np.asarray(scipy.signal.lfilter(self.denominator, self.numerator, x, axis=0) * self._gain / self.std)


def draw_noise(rng: np.random.Generator, std: float) -> Noise:
    """Return noise of a random slope; slopes end in white noise at a random corner."""
    slope = str(rng.choice(SLOPES))
    corner = np.pi * float(np.exp(rng.uniform(np.log(0.01), np.log(0.3))))
    if slope == "white":
        return Noise(slope, std, np.ones(1), np.ones(1))
    if slope == "1/f^2":
        return Noise(slope, std, _factor(corner), _factor(max(corner / 100.0, 1e-3)))
    if slope == "1/f":
        numerator, denominator = np.ones(1), np.ones(1)
        for k in range(4):
            numerator = np.convolve(numerator, _factor(corner * 4.0**-k))
            denominator = np.convolve(denominator, _factor(corner * 4.0**-k / 2.0))
        return Noise(slope, std, numerator, denominator)
    wide, narrow = rng.uniform(0.6, 0.9), rng.uniform(0.15, 0.3)
    return Noise(slope, std, _pair(corner, wide), _pair(corner, narrow))


def _factor(corner: float) -> Array:
    return np.array([1.0, -np.exp(-corner)])


def _pair(corner: float, ratio: float) -> Array:
    root = np.exp(corner * (-ratio + 1j * np.sqrt(1.0 - ratio**2)))
    return np.array([1.0, -2.0 * root.real, abs(root) ** 2])
