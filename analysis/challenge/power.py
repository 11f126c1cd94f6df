"""How well an effect that is known only by its statistics can be seen: the change of power against the noise's.

For a Gaussian process whose variance in the i-th of many independent cells is raised by a small part r_i, the best test
is a weighted sum of squares, and its deflection is d² = ½ Σ r_i². What the diagnosis cannot know beforehand is
projected out of r: the noise's level and its smooth colour.

A vibration has rivals that are random as well: the noise of an amplifier acts on the readings through the same plant,
and where the plant's resonance is above the noise floor both leave the same hump.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.challenge.campaign import Campaign
from analysis.challenge.families import Hidden
from analysis.challenge.families.sensor import ApexNoise
from analysis.challenge.families.surroundings import BroadbandVibration

Array = NDArray[np.float64]

_COLOUR_TERMS = 6
"""Terms of a polynomial over the logarithm of the frequency that stand for the unknown colour of the noise."""

_CELLS = 4096

_CORNERS_PER_OCTAVE = 2
"""How densely the corners of an amplifier's low pass are tried."""


def random_energy(effect: Hidden, campaign: Campaign) -> float:
    """Return d² of a random effect over the samples that may be fitted."""
    if isinstance(effect, ApexNoise):
        return _of_apex(effect, campaign)
    assert isinstance(effect, BroadbandVibration)
    contrast = _Contrast.of(effect, campaign)
    return contrast.energy(contrast.vibration)


def energy_beyond_amplifiers(effect: Hidden, campaign: Campaign) -> float:
    """Return what the noise of an amplifier, at any axis and of any bandwidth, leaves of d².

    Noise that grows with the angle is recognised by when it is loud, which no noise of an amplifier explains.
    """
    if not isinstance(effect, BroadbandVibration):
        return random_energy(effect, campaign)
    contrast = _Contrast.of(effect, campaign)
    return min(contrast.energy(contrast.vibration, rival) for rival in contrast.amplifiers())


def _of_apex(effect: ApexNoise, campaign: Campaign) -> float:
    """Cells are samples; whitening distributes each sample's added variance over the taps of the inverse filter."""
    noise = campaign.noises[effect.axis]
    taps = noise.whiten(np.eye(400)[:, :1])[:, 0] ** 2
    parts = []
    for run, motion in zip(campaign.runs, campaign.motions(()), strict=True):
        added = effect.deviation(motion.sampled()[:, effect.axis]) ** 2
        parts.append(np.convolve(added, taps)[: added.size][run.rows(held_out=False)])
    r = np.concatenate(parts)
    r = r / (1.0 + r)
    return float(0.5 * np.sum((r - np.mean(r)) ** 2))


@dataclass(frozen=True)
class _Contrast:
    """Random torques as parts of the spectra that are there with the vibration, beyond any smooth colour.

    Cells are frequencies up to half the sample rate, (f,), of every reading (r,), each standing for `samples` numbers.
    `power` (r, f, axis) is what a torque of unit power at an axis adds, over the spectra. `vibration` (r, f) is the
    effect.
    """

    frequency_hz: Array
    power: Array
    vibration: Array
    samples: float

    @classmethod
    def of(cls, effect: BroadbandVibration, campaign: Campaign) -> _Contrast:
        """Return the vibration and what the same plant makes of other torques."""
        excitation = campaign.runs[0].excitation
        rate_hz = excitation.rate_hz
        frequency = np.asarray((np.arange(_CELLS) + 0.5) * rate_hz / (2.0 * _CELLS), dtype=float)
        numerator, denominator = effect.filter(excitation.fine_s)
        z = np.exp(-2j * np.pi * frequency * excitation.fine_s)
        torque = effect.size**2 * np.abs(numerator[0] / np.polyval(denominator[::-1], z)) ** 2 / excitation.substeps
        gain = np.abs(campaign.plant.response(frequency).swapaxes(0, 1)) ** 2
        added = gain[:, :, effect.axis] * torque
        there = added + np.array([noise.density(frequency, rate_hz) for noise in campaign.noises])
        samples = sum(int(run.rows(held_out=False).sum()) for run in campaign.runs)
        return cls(frequency, gain / there[:, :, None], added / there, samples / _CELLS)

    def amplifiers(self) -> list[Array]:
        """Return the noise of an amplifier at every axis, of any size: white, and through low passes of first order."""
        low, high = float(self.frequency_hz[0]), float(self.frequency_hz[-1])
        corners = [np.inf, *np.geomspace(low, high, int(np.log2(high / low) * _CORNERS_PER_OCTAVE))]
        passes = [1.0 / (1.0 + (self.frequency_hz / corner) ** 2) for corner in corners]
        return [self.power[:, :, axis] * shape for axis in range(self.power.shape[2]) for shape in passes]

    def energy(self, part: Array, rival: Array | None = None) -> float:
        """Return ½ Σ r² of a part (r, f) of the spectra beyond their colour, and beyond a rival that can but add."""
        left = self._beyond_colour(part)
        if rival is not None:
            other = self._beyond_colour(rival / np.max(rival))
            square = float(np.sum(other**2))
            if square > 0.0:
                left = left - max(float(np.sum(left * other)) / square, 0.0) * other
        return float(0.5 * self.samples * np.sum(left**2))

    def _beyond_colour(self, part: Array) -> Array:
        at = np.log(self.frequency_hz)
        at = 2.0 * (at - at[0]) / (at[-1] - at[0]) - 1.0
        colour = np.polynomial.chebyshev.chebvander(at, _COLOUR_TERMS - 1)
        return np.asarray(part - (colour @ np.linalg.lstsq(colour, part.T, rcond=None)[0]).T)
