"""A measured frequency response, entry by entry, as it is written to files: magnitude, phase and their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.frequency.frf import FrequencyResponse
from analysis.recorded.sweep import Sweep
from campaigns.spreadsheet import inert_frame
from sim_backend.errors import ConfigError
from sim_backend.safe_write import whole_text_file

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ResponseCurve:
    """The response from one input to one output, each array (n_f,), magnitudes in output unit per input unit.

    `std` is the standard deviation of the magnitude, and over it that of the phase in rad, from noise and, where
    realisations tell it, nonlinear distortion; `noise_std` is from noise alone. NaN is what the record cannot tell.
    """

    output: str
    input: str
    frequency_hz: Array
    magnitude: Array
    phase_rad: Array
    std: Array
    noise_std: Array


def curves_of_periods(
    measured: FrequencyResponse, inputs: tuple[str, ...], outputs: tuple[str, ...]
) -> tuple[ResponseCurve, ...]:
    """Return every entry of a response, whose channels are `inputs` and `outputs`."""
    total = np.where(np.isfinite(measured.total_variance), measured.total_variance, measured.noise_variance)
    return tuple(
        _curve(
            o, i, measured.frequency_hz, measured.response[:, k, j], total[:, k, j], measured.noise_variance[:, k, j]
        )
        for k, o in enumerate(outputs)
        for j, i in enumerate(inputs)
    )


def curve_of_sweep(sweep: Sweep, input_: str, output: str) -> ResponseCurve:
    """Return the response of one axis; of a stepped sine, all that is not a sine of its frequency counts as noise."""
    return _curve(output, input_, sweep.frequency_hz, sweep.response, sweep.variance, sweep.variance)


def _curve(
    output: str, input_: str, frequency_hz: Array, response: NDArray[np.complex128], total: Array, noise: Array
) -> ResponseCurve:
    # |error|² is shared by the directions along and across the response; only that along changes the magnitude
    spread = [np.sqrt(0.5 * variance) for variance in (total, noise)]
    return ResponseCurve(output, input_, frequency_hz, np.abs(response), np.angle(response), *spread)


def require_new(curves: tuple[ResponseCurve, ...], path: Path) -> None:
    """Raise ConfigError where there are no curves to write to `path`, or where it exists."""
    if not curves:
        raise ConfigError(f"{path}: this record gives a model but no response by frequency; excite it periodically")
    if path.exists():
        raise ConfigError(f"{path} exists and is not overwritten; choose another path")


def save_curves(curves: tuple[ResponseCurve, ...], path: Path) -> None:
    """Write the curves as one CSV table; raises ConfigError as `require_new`."""
    require_new(curves, path)
    import pandas as pd  # a third of a second, which only this needs

    frames = [pd.DataFrame({name: getattr(curve, name) for name in curve.__dataclass_fields__}) for curve in curves]
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_text_file(path, replace=False) as file:
        inert_frame(pd.concat(frames, ignore_index=True)).to_csv(file, index=False)
