"""Disturbances of a bench at rest: the torque that drives it and the noise of its readings, separated by the plant.

The reading at rest is the plant's answer to a torque of first order, plus white noise. Its periodogram, averaged in
bands, is compared with that spectrum by Whittle's likelihood. Source: P. Whittle, Arkiv för Matematik 2 (1953).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from analysis.measurements.arrays import finite, positive
from sim_backend.control.lqg import Noise
from sim_backend.errors import DataError
from sim_backend.linear import ModalModel, discretise

Array = NDArray[np.float64]

STRETCH_S = 2.0
"""Length of the stretches that are averaged: lines of 0.5 Hz separate the modes."""

STRETCHES = 4
"""Fewest stretches in a record: the average of fewer says too little of the spectrum."""

LOWEST_HZ = 1.0
RINGING = 0.1
"""Lines nearer than this part to a mode's frequency are left out: hysteresis shifts a mode at small amplitude, and a
shifted peak would be taken for noise of another size."""

BANDWIDTHS_HZ = (10.0, 50.0, 250.0, 1000.0)


@dataclass(frozen=True)
class MeasuredNoise:
    """The noise of one axis and how far it is known.

    `relative_std` holds that of torque, bandwidth and reading noise. `frequency_hz`, `measured` and `fitted` (n_f,) are
    one-sided densities of the reading, rad²/Hz; `misfit` is the mean of measured over fitted, 1 for a perfect fit.
    """

    noise: Noise
    relative_std: Array
    frequency_hz: Array
    measured: Array
    fitted: Array
    misfit: float


def measure_noise(reading_rad: ArrayLike, plant: ModalModel, rate_hz: float) -> MeasuredNoise:
    """Return the noise of a bench at rest from one axis's reading (n,), loops open; raises DataError when it is short.

    `plant` is the axis's model, one input and one output.
    """
    rate = positive("noise: the sample rate", rate_hz)
    stretch = round(STRETCH_S * rate)
    y = finite("noise at rest", reading_rad, 1, least=0)
    if y.size < STRETCHES * stretch:
        raise DataError(
            f"noise at rest: the record lasts {y.size / rate:.3g} s, and a design needs {STRETCHES * STRETCH_S:g} s or "
            f"more of the bench at rest: record the plan 'rest' again with duration_s={STRETCHES * STRETCH_S:g} or more"
        )
    f, measured = scipy.signal.welch(y - y.mean(), rate, nperseg=stretch)
    modes_hz = plant.omega_rad_s / (2.0 * np.pi)
    ringing = np.any(np.abs(f[:, None] - modes_hz) < RINGING * modes_hz, axis=1)
    use = (f >= LOWEST_HZ) & (f < 0.49 * rate) & ~ringing
    f, measured = f[use], measured[use]
    gain = np.abs(discretise(plant, rate).frequency_response(f)[:, 0, 0]) ** 2

    def density(logs: Array) -> Array:
        noise = Noise(*np.exp(logs))
        torque = (noise.torque_nm * noise.colour(f, rate)) ** 2 * gain
        return np.asarray(2.0 / rate * (torque + noise.reading_rad**2))

    def cost(logs: Array) -> float:
        model = density(logs)
        return float(np.sum(np.log(model) + measured / model))

    if not measured.any():
        raise DataError("noise at rest: the reading never changes; a design weighs noise: record a bench that has some")
    reading = float(np.sqrt(np.median(measured[f > 0.25 * rate]) * rate / 2.0))
    slow = f < 0.01 * rate
    starts = []
    for bandwidth in BANDWIDTHS_HZ:
        unit = np.mean(measured[slow]) / np.mean(gain[slow] * Noise(1.0, bandwidth, 1.0).colour(f, rate)[slow] ** 2)
        starts.append(np.log([np.sqrt(unit * rate / 2.0), bandwidth, reading]))
    options = {"xatol": 1e-4, "fatol": 1e-6, "maxiter": 2000}
    found = min(
        (scipy.optimize.minimize(cost, s, method="Nelder-Mead", options=options) for s in starts),
        key=lambda r: float(r.fun),
    )
    if not np.all(np.isfinite(found.x)):
        raise DataError("noise at rest: no torque and reading noise fit the spectrum; record a bench that moves freely")
    fitted = density(found.x)
    averages = 2.0 * y.size / stretch * 0.9  # Welch's overlapping Hann windows: 0.9 of them count as independent
    return MeasuredNoise(
        Noise(*(float(v) for v in np.exp(found.x))),
        _relative_std(density, found.x, averages),
        f,
        measured,
        fitted,
        float(np.mean(measured / fitted)),
    )


def _relative_std(density: object, logs: Array, averages: float) -> Array:
    """Standard deviations of the logarithms by Fisher's information of averaged exponential ordinates."""
    assert callable(density)
    step = 1e-3
    slopes = np.stack([(np.log(density(logs + e)) - np.log(density(logs - e))) / (2 * step) for e in step * np.eye(3)])
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(averages * (slopes @ slopes.T)))))
