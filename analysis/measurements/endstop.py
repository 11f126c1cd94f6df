"""Noise of the position sensors with the mechanism held against its end stops: 3σ per position and sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.measurements.arrays import finite, positive
from analysis.measurements.spread import spread

Array = NDArray[np.float64]

NOISE_LIMIT_M = 30e-9
"""3σ that the sensors may show, section 6.1.2."""


@dataclass(frozen=True)
class EndstopNoise:
    """Sensor noise over `p` positions and `s` sensors, each array (p, s), in m or m/s.

    `three_sigma_m` is about the straight line through each record, `three_sigma_std_m` its uncertainty,
    `drift_m_s` the slope that was taken out.
    """

    three_sigma_m: Array
    three_sigma_std_m: Array
    drift_m_s: Array

    @property
    def worst_m(self) -> float:
        """Largest 3σ over all positions and sensors."""
        return float(np.max(self.three_sigma_m))


def endstop_noise(readings_m: ArrayLike, rate_hz: float) -> EndstopNoise:
    """Return the noise of readings (p, n, s): positions, samples, sensors; section 6.2.1.

    Raises DataError for fewer than three samples, a number that is not finite or a rate that is not positive.
    """
    readings = finite("end stops", readings_m, 3, least=3, axis=1)
    positive("end stops: the sample rate", rate_hz)
    per_position = [spread(block) for block in readings]
    return EndstopNoise(
        three_sigma_m=3.0 * np.stack([s.std for s in per_position]),
        three_sigma_std_m=3.0 * np.stack([s.std_error for s in per_position]),
        drift_m_s=np.stack([s.slope for s in per_position]) * rate_hz,
    )
