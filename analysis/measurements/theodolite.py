"""Gain of the angle sensors against a theodolite: straight-line regression with standard deviations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.measurements.arrays import finite
from sim_backend.errors import DataError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Calibration:
    """Line through `k` axes, theodolite = (1 + gain_correction) · sensor + offset, each array (k,).

    `gain_correction_std` and `offset_std_rad` come from the residuals, `residual_rms_rad`. `correlation` is the
    squared correlation.
    """

    gain_correction: Array
    gain_correction_std: Array
    offset_rad: Array
    offset_std_rad: Array
    residual_rms_rad: Array
    correlation: Array


def calibrate(sensor_rad: ArrayLike, theodolite_rad: ArrayLike) -> Calibration:
    """Return the gain corrections from angles (n, k) of both instruments at the same n positions; section 6.2.1.

    The theodolite carries all the scatter: averaged sensor readings are quieter by orders of magnitude. Raises
    DataError for fewer than three positions, shapes that differ, or an axis that never moves.
    """
    x = finite("theodolite: sensor angles", sensor_rad, 2, least=3)
    y = finite("theodolite: readings", theodolite_rad, 2, least=3)
    if x.shape != y.shape:
        raise DataError(
            f"theodolite: {x.shape} sensor angles and {y.shape} readings; give one reading per position and axis"
        )
    n = x.shape[0]
    dx, dy = x - x.mean(axis=0), y - y.mean(axis=0)
    sxx = np.sum(dx**2, axis=0)
    if np.any(sxx == 0.0):
        axis = int(np.argmin(sxx))
        raise DataError(f"theodolite: axis {axis + 1} stays at {x[0, axis]:.4g} rad; its gain needs several angles")
    gain = np.sum(dx * dy, axis=0) / sxx
    residual = dy - gain * dx
    variance = np.sum(residual**2, axis=0) / (n - 2)
    total = np.sum(dy**2, axis=0)
    return Calibration(
        gain_correction=gain - 1.0,
        gain_correction_std=np.sqrt(variance / sxx),
        offset_rad=y.mean(axis=0) - gain * x.mean(axis=0),
        offset_std_rad=np.sqrt(variance * (1.0 / n + x.mean(axis=0) ** 2 / sxx)),
        residual_rms_rad=np.sqrt(variance),
        correlation=1.0 - np.divide(np.sum(residual**2, axis=0), total, out=np.zeros_like(total), where=total > 0.0),
    )
