"""The motion that was measured: the linear simulation plus what of its residual stands above the noise.

Effects act along the true motion. Where the nominal model is good the two hardly differ; where it is not (a rigid
axis under unmodelled friction, say) the simulation alone would drift away. The residual is cleaned of noise by a
Wiener filter.

An error of a sensor is another matter: the residual is the error then, and none of the motion. If it were taken as
motion, a sensor's gain, of which the knobs can imitate everything but that residual, would explain whatever is there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.diagnosis.candidates.signature import Motion
from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.records.dataset import Record

Array = NDArray[np.float64]

_OVERSUBTRACTION = 6.0
"""A frequency counts as motion only where the smoothed power is this many times the noise: beyond its chance
fluctuations."""

_MOVED = 0.1
"""An output moves when its simulation is at least this part of its residual."""


def measured_motion(record: Record, simulated: Array, residual: Array, whitener: Whitener, rate_hz: float) -> Motion:
    """Return the motion of a record from its `simulated` position and the fit's `residual`, both (n, n_y)."""
    cleaned = np.stack([_clean(residual[:, o], whitener, o) for o in range(record.y.shape[1])], axis=1)
    # where next to nothing was driven, all that moves is noise and what leaks from other axes: no motion to act along
    moved = np.std(simulated, axis=0) > _MOVED * np.std(residual, axis=0)
    position = np.where(moved, simulated + cleaned, simulated)
    return Motion(
        record.u, position, simulated, np.gradient(position, 1.0 / rate_hz, axis=0), residual, record.temperature_k
    )


def moved_as(record: Record, position: Array, rate_hz: float) -> Motion:
    """Return the motion of a record along a `position` (n, n_y) that was simulated."""
    rate = np.gradient(position, 1.0 / rate_hz, axis=0)
    return Motion(record.u, position, position, rate, np.zeros_like(position), record.temperature_k)


def as_simulated(motion: Motion, rate_hz: float) -> Motion:
    """Return a motion without what its residual may hold of it."""
    return replace(motion, position=motion.sensed, rate=np.gradient(motion.sensed, 1.0 / rate_hz, axis=0))


def _clean(x: Array, whitener: Whitener, output: int) -> Array:
    """Return `x` (n,) without its noise: reflected at both ends, weighted in frequency, and cut back."""
    n = x.size
    pad = min(n - 1, 4096)
    # odd reflection keeps value and slope at the ends, so that the filter sees no step there
    longer = np.concatenate([2 * x[0] - x[pad:0:-1], x, 2 * x[-1] - x[-2 : -pad - 2 : -1]])
    spectrum = np.fft.rfft(longer)
    power = np.abs(spectrum) ** 2 / longer.size
    total = scipy.ndimage.uniform_filter1d(power, max(power.size // 200, 5), mode="nearest")
    if whitener.repeats:
        noise = 1.0 / np.abs(np.fft.rfft(whitener.taps[output], longer.size)) ** 2
    else:
        noise = np.full(power.size, float(np.quantile(total, 0.1)))
    # noise that leaked into a candidate's motion would correlate with the residual it is compared with: leave all of
    # it out
    gain = np.clip(1.0 - _OVERSUBTRACTION * noise / np.maximum(total, np.finfo(float).tiny), 0.0, 1.0)
    return np.asarray(np.fft.irfft(gain * spectrum, longer.size)[pad : pad + n], dtype=float)
