"""How likely a spectrum is under a smooth floor, and under one with a random torque through the plant on top.

The likelihood is Whittle's (1953), in bins of ordinates of the cosine transform. The floor of every output is the
exponential of a polynomial over the logarithm of the frequency.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.variance.spectrum import HIGHEST, Spectrum
from analysis.diagnosis.variance.torques import Fits, Fitting, Start, Torques, free_of
from sim_backend.linear import Array, ModalModel


@dataclass(frozen=True)
class Band:
    """A random torque at input number `input`: its standard deviation and where its power lies.

    An infinite width is all frequencies alike, a centre of zero a low pass. `std` are the standard deviations of rms,
    centre and width, zero of what is not fitted.
    """

    input: int
    rms: float
    centre_hz: float
    width_hz: float
    steep: bool
    std: tuple[float, float, float]
    log_likelihood: float
    terms: int

    @property
    def low_pass(self) -> bool:
        """Whether it is strongest at the lowest frequencies, or as strong at all: the noise of an amplifier."""
        return math.isinf(self.width_hz) or self.centre_hz == 0.0


@dataclass(frozen=True)
class Whittle:
    """The likelihood of a spectrum: each output's floor, and on it a torque's power through the plant.

    `gain` (n_y, n_u, k, points) are the squared gains of the plant.
    """

    spectrum: Spectrum
    gain: Array
    rate_hz: float

    @classmethod
    def of(cls, spectrum: Spectrum, linear: ModalModel, rate_hz: float) -> Whittle:
        """Return the likelihood of `spectrum` for torques through `linear`."""
        f = spectrum.frequency_hz
        response = np.abs(linear.frequency_response(f.ravel())) ** 2
        return cls(spectrum, np.moveaxis(response.reshape(*f.shape, *response.shape[1:]), (0, 1), (2, 3)), rate_hz)

    def humps(self, starts: Sequence[Start]) -> Array:
        """Return the power (b, n_y, k) that the torque of each start adds."""
        torques = self._torques(starts)
        return torques.powers(torques.numbers, np.arange(len(starts)))

    def floor(self, terms: int) -> tuple[Array, float]:
        """Return the floor (n_y, k) of so many terms and its log-likelihood."""
        nothing = self._torques([(0, 0.0, math.inf, False, 1.0)])
        fits = self._fitted(terms, self.spectrum.power, replace(nothing, gain=0.0 * nothing.gain))
        return fits.floors[0], -float(fits.loss[0])

    def bands(self, terms: int, starts: Sequence[Start], floor: Array) -> list[Band | None]:
        """Return the best band from each start, over a floor of so many terms that starts at `floor` (n_y, k)."""
        torques = self._torques(starts)
        fits = self._fitted(terms, floor, torques)
        centres, widths = torques.places(fits.numbers, np.arange(len(starts)))
        deviations = np.sqrt(np.maximum(fits.variances, 0.0))
        found: list[Band | None] = []
        for b, (j, _, _, steep, _) in enumerate(starts):
            rms, place = math.exp(0.5 * fits.numbers[b, 0]), (float(centres[b]), float(widths[b]))
            parts = [
                float(part) * value if free else 0.0
                for part, value, free in zip(deviations[b, 1:], place, free_of(*starts[b][1:3]), strict=True)
            ]
            std, loss = (0.5 * rms * float(deviations[b, 0]), parts[0], parts[1]), float(fits.loss[b])
            found.append(Band(j, rms, *place, steep, std, -loss, terms) if math.isfinite(loss) else None)
        return found

    def strength(self, band: Band) -> tuple[float, float]:
        """Return the factor by which this spectrum shows the power of `band`, and its standard deviation."""
        torque = self._torques([(band.input, band.centre_hz, band.width_hz, band.steep, 0.5)])
        held = replace(torque, gain=band.rms**2 * torque.gain, free=np.array([[True, False, False]]))
        fits = self._fitted(band.terms, self.spectrum.power, held)
        factor = math.exp(fits.numbers[0, 0])
        return factor, factor * math.sqrt(max(float(fits.variances[0, 0]), 0.0))

    def _torques(self, starts: Sequence[Start]) -> Torques:
        return Torques.of(self.gain, self.spectrum.frequency_hz, self.rate_hz, starts, self.rate_hz * HIGHEST)

    def _fitted(self, terms: int, floor: Array, torques: Torques) -> Fits:
        at = np.log(self.spectrum.frequency_hz.mean(axis=1))
        basis = np.polynomial.chebyshev.chebvander(2.0 * (at - at[0]) / (at[-1] - at[0]) - 1.0, terms - 1)
        return Fitting(self.spectrum, basis, torques).fitted(floor)
