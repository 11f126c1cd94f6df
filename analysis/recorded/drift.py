"""A recorded long chop: the drift of its positions while the mechanism warms up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.measurements.thermal import Drift, drift
from analysis.recorded.chop import TIP_TILT, chop_phase
from campaigns.log import Run

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DriftTest:
    """Mean positions of every integration period: `time_s` (2, n), `mean_rad` (2, n, 2), position 1 first.

    `drift` holds one result per position, over (θx, θy); `warming_k` is the rise of temperature where it was recorded.
    """

    time_s: Array
    mean_rad: Array
    drift: tuple[Drift, Drift]
    warming_k: float | None

    @property
    def offset_rad(self) -> Array:
        """Mean of every integration period (2, n, 2) less the mean of all at its position; Fig. 6.16."""
        return np.asarray(self.mean_rad - self.mean_rad.mean(axis=1, keepdims=True))


def drift_of(run: Run) -> DriftTest:
    """Return the drift of a long chop; Fig. 6.16. Raises DataError for a log without a chop."""
    phase = chop_phase(run)
    means = phase.window_means(*TIP_TILT)
    n = means.shape[1]
    middle = phase.dwell - 0.5 * phase.window
    first = phase.start + np.array([phase.dwell + middle, middle])
    time_s = (first[:, None] + phase.period * np.arange(n)) / phase.rate_hz
    warming = None
    if "temperature" in run.channels:
        warming = float(run.read("temperature", run.rows - 1)[0]) - float(run.read("temperature", 0, 1)[0])
    one, two = (drift(t, m) for t, m in zip(time_s, means, strict=True))
    return DriftTest(time_s, means, (one, two), warming)
