"""The response of a model as it is drawn and compared: at which frequencies, and between samples as it is simulated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.identification.response_curves import ResponseCurve
from sim_backend.intersample import hold_response
from sim_backend.linear import Array, ComplexArray
from sim_backend.model import Model

POINTS = 800


def frequencies_of(model: Model, curves: Sequence[ResponseCurve]) -> Array:
    """Return frequencies (POINTS,) in Hz over what was measured; of a model by itself, from below its lowest mode."""
    rate_hz = model.sample_rate_hz
    own = [0.1 * omega / (2.0 * np.pi) for omega in model.linear().omega_rad_s.tolist() if omega > 0.0]
    alone = np.array([*own, 0.5 * rate_hz])
    frequency = np.concatenate([curve.frequency_hz for curve in curves]) if curves else alone
    low = max(float(frequency[frequency > 0.0].min(initial=np.inf)), 1e-4 * rate_hz)
    return np.geomspace(min(low, 0.1 * rate_hz), min(max(float(frequency.max()), 2.0 * low), 0.499 * rate_hz), POINTS)


def response_of(model: Model, frequency_hz: Array, *, continuous: bool = False) -> ComplexArray:
    """Return the response (n_f, n_y, n_u) of a model as it is simulated, or the one of its `continuous` input."""
    linear, rate_hz = model.linear(), model.sample_rate_hz
    if continuous:
        return linear.frequency_response(frequency_hz)
    response = linear.frequency_response(frequency_hz, rate_hz)
    if model.intersample == "band-limited":
        response = response / hold_response(frequency_hz / rate_hz)[:, None, None]
    return response
