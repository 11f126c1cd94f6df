"""How well an effect that is known only by its statistics can be seen: the change of power against the noise's.

For a Gaussian process whose variance in the i-th of many independent cells is raised by a small part r_i, the best test
is a weighted sum of squares, and its deflection is d² = ½ Σ r_i². What the diagnosis cannot know beforehand is
projected out of r: the noise's level and its smooth colour.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from campaigns.challenge.campaign import Campaign
from campaigns.challenge.families import Hidden
from campaigns.challenge.families.sensor import ApexNoise
from campaigns.challenge.families.surroundings import BroadbandVibration
from campaigns.challenge.noise import Noise

Array = NDArray[np.float64]

_COLOUR_TERMS = 6
"""Terms of a polynomial over the logarithm of the frequency that stand for the unknown colour of the noise."""

_CELLS = 4096


def random_energy(effect: Hidden, campaign: Campaign) -> float:
    """Return d² of a random effect over the samples that may be fitted."""
    if isinstance(effect, ApexNoise):
        return _of_apex(effect, campaign)
    assert isinstance(effect, BroadbandVibration)
    return _of_vibration(effect, campaign)


def _of_apex(effect: ApexNoise, campaign: Campaign) -> float:
    """Cells are samples; whitening spreads each sample's added variance over the taps of the inverse filter."""
    noise = campaign.noises[effect.axis]
    taps = noise.whiten(np.eye(400)[:, :1])[:, 0] ** 2
    parts = []
    for run, motion in zip(campaign.runs, campaign.motions(()), strict=True):
        added = effect.deviation(motion.sampled()[:, effect.axis]) ** 2
        parts.append(np.convolve(added, taps)[: added.size][run.rows(held_out=False)])
    r = np.concatenate(parts)
    r = r / (1.0 + r)
    return float(0.5 * np.sum((r - np.mean(r)) ** 2))


def _of_vibration(effect: BroadbandVibration, campaign: Campaign) -> float:
    """Cells are frequencies up to half the sample rate, each standing for the samples over their number."""
    excitation = campaign.runs[0].excitation
    frequency = np.asarray((np.arange(_CELLS) + 0.5) * excitation.rate_hz / (2.0 * _CELLS), dtype=float)
    numerator, denominator = effect.filter(excitation.fine_s)
    z = np.exp(-2j * np.pi * frequency * excitation.fine_s)
    torque = effect.size**2 * np.abs(numerator[0] / np.polyval(denominator[::-1], z)) ** 2 / excitation.substeps
    response = campaign.plant.response(frequency)[:, :, effect.axis]
    samples = sum(int(run.rows(held_out=False).sum()) for run in campaign.runs)
    return math.fsum(
        _contrast(np.abs(response[:, a]) ** 2 * torque, noise, frequency, excitation.rate_hz) * samples / (2.0 * _CELLS)
        for a, noise in enumerate(campaign.noises)
    )


def _contrast(added: Array, noise: Noise, frequency_hz: Array, rate_hz: float) -> float:
    floor = noise.density(frequency_hz, rate_hz)
    r = added / (floor + added)
    at = np.log(frequency_hz)
    at = 2.0 * (at - at[0]) / (at[-1] - at[0]) - 1.0
    colour = np.polynomial.chebyshev.chebvander(at, _COLOUR_TERMS - 1)
    r = r - colour @ np.linalg.lstsq(colour, r, rcond=None)[0]
    return float(np.sum(r**2))
