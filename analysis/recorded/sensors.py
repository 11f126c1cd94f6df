"""Recorded tests of the sensors: noise against the end stops, and gain against a theodolite."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.measurements.endstop import EndstopNoise, endstop_noise
from analysis.measurements.theodolite import Calibration, calibrate
from analysis.recorded.chop import TIP_TILT
from campaigns.log import Run
from sim_backend.errors import DataError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EndstopTest:
    """Noise in `p` end-stop positions, `positions` by the signs of the pull, of `sensors` by channel name."""

    positions: tuple[str, ...]
    sensors: tuple[str, ...]
    noise: EndstopNoise


def endstops_of(run: Run) -> EndstopTest:
    """Return the noise of every hold against the end stops; raises DataError when the run holds none."""
    holds = [s for s in run.segments if s.settings.get("phase") == "hold" and "signs" in s.settings]
    if not holds:
        raise DataError(f"{run.path} holds no end-stop positions: it is a log of '{run.header.test}'")
    sensors = tuple(n for n in run.channels if n.startswith("head_")) or run.names("output")
    shortest = min(s.rows for s in holds)
    readings = np.stack(
        [np.stack([run.read(name, s.stop - shortest, s.stop) for name in sensors], axis=1) for s in holds]
    )
    return EndstopTest(
        tuple(str(s.settings["signs"]) for s in holds), sensors, endstop_noise(readings, run.sample_rate_hz)
    )


@dataclass(frozen=True)
class TheodoliteTest:
    """Angles (n, 2) of both instruments at the held points, in rad, and the lines through them."""

    sensor_rad: Array
    theodolite_rad: Array
    calibration: Calibration


def theodolite_of(run: Run, readings_rad: Array | None = None) -> TheodoliteTest:
    """Return the gain of the angle sensors, against the recorded instrument or against `readings_rad` (n, 2).

    Raises DataError when there is no instrument, or not one reading per held point.
    """
    holds = [s for s in run.segments if s.settings.get("phase") == "hold"]
    if not holds:
        raise DataError(
            f"{run.path} holds no held points: it is a log of '{run.header.test}', give one of 'theodolite'"
        )

    def means(names: tuple[str, ...]) -> Array:
        return np.array([[run.read(name, s.start, s.stop).mean() for name in names] for s in holds])

    instrument = tuple(f"theodolite_{dof}" for dof in TIP_TILT)
    if readings_rad is None and not set(instrument) <= set(run.channels):
        raise DataError(f"{run.path} records no theodolite; give its readings, one row per held point")
    sensor = means(TIP_TILT)
    readings = means(instrument) if readings_rad is None else np.asarray(readings_rad, dtype=float)
    return TheodoliteTest(sensor, readings, calibrate(sensor, readings))
