"""Frequency response of records that are not periodic: local polynomials (for short records) and Welch averages."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.frequency.averaged_spectra import averaged_spectra
from analysis.frequency.cross_spectra import ComplexArray
from analysis.frequency.frf import FrequencyResponse
from sim_backend.errors import ConfigError, DataError
from sim_backend.linear import Array


def _checked(inputs: Array, outputs: Array, reference: Array | None) -> None:
    """Refuse records that do not belong together."""
    if inputs.ndim != 2 or outputs.ndim != 2 or inputs.shape[0] != outputs.shape[0]:
        raise ConfigError(f"input {inputs.shape} and output {outputs.shape}; needs (n, channels) with the same n")
    if reference is not None and reference.shape != inputs.shape:
        raise ConfigError(
            f"reference has shape {reference.shape}, input {inputs.shape}; a closed loop needs one per input"
        )
    for name, record in (("input", inputs), ("reference", reference)):
        if record is not None and np.any(np.ptp(record, axis=0) == 0.0):
            channel = int(np.argmin(np.ptp(record, axis=0)))
            raise DataError(f"{name} channel {channel} is constant; there is nothing to measure a response with")


def frequency_response_local(
    inputs: Array,
    outputs: Array,
    rate_hz: float,
    *,
    reference: Array | None = None,
    half_width: int | None = None,
    degree: int = 2,
    step: int | None = None,
) -> FrequencyResponse:
    """Return the response of one arbitrary record by local polynomials, transients removed.

    Shapes: `inputs` (n, n_u), `outputs` (n, n_y), `reference` (n, n_u) in a closed loop. Around each line, response and
    transient are polynomials of `degree` over 2 `half_width` + 1 lines (Pintelon & Schoukens 2012, section 7.2); with
    a reference the response from it to (u, y) is estimated and divided. `step` lines lie between two results; the
    default leaves them independent, a smaller one gives a finer curve whose neighbours share data. Noise and
    distortion cannot be separated: both variances are the total. Raises DataError when the record is too short.
    """
    _checked(inputs, outputs, reference)
    n, n_u = inputs.shape
    unknowns = (n_u + 1) * (degree + 1)
    width = unknowns // 2 + 3 if half_width is None else half_width
    span = 2 * width + 1
    dof = span - unknowns
    if dof < 1:
        raise ConfigError(
            f"half width {width} gives {span} lines for {unknowns} unknowns; needs at least {unknowns // 2 + 1}"
        )
    bins = n // 2 - 1
    if bins < span:
        raise DataError(
            f"record of {n} samples has {bins} lines, fewer than the {span} of one window; needs {2 * span + 4} samples"
        )
    drive = inputs if reference is None else reference
    both = outputs if reference is None else np.concatenate([inputs, outputs], axis=1)
    w, z = (scipy.fft.rfft(x - x.mean(axis=0), axis=0, norm="forward") for x in (drive, both))
    centre = np.arange(1 + width, bins - width + 1, span if step is None else step)
    response, cross, gain = _local_fit(w, z, centre, width, degree, dof)
    if reference is not None:
        response, cross, gain = _divide(response, cross, gain, n_u)
    noise = np.einsum("fyy->fy", cross).real
    variance = noise[:, :, None] * np.einsum("fuu->fu", gain).real[:, None, :]
    power = np.abs(z[centre, -outputs.shape[1] :]) ** 2
    unknown = np.full(noise.shape, np.nan)
    return FrequencyResponse(
        centre * rate_hz / n, response, variance, variance, 2.0 * noise, unknown, 2.0 * power, dof, dof
    )


def _local_fit(
    w: ComplexArray, z: ComplexArray, centre: NDArray[np.intp], width: int, degree: int, dof: int
) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Return response (f, n_z, n_w), residual covariance (f, n_z, n_z) and (K'K)^-1 of the response's columns."""
    offset = np.arange(-width, width + 1)
    powers = (offset[:, None] / width) ** np.arange(degree + 1)
    n_w = w.shape[1]
    found, cross, gain = [], [], []
    for part in np.array_split(centre, max(1, centre.size // 4096)):
        near = part[:, None] + offset
        # a transient's size has nothing to do with the input's: the columns are brought to one scale
        size = np.sqrt(np.mean(np.abs(w[near]) ** 2, axis=(1, 2)))[:, None, None, None]
        columns = np.concatenate([w[near], np.broadcast_to(size[..., 0], (*near.shape, 1))], axis=2)
        regressor = (powers[None, :, :, None] * columns[:, :, None, :]).reshape(part.size, offset.size, -1)
        q, r = np.linalg.qr(regressor)
        data = z[near]
        inverse = np.linalg.inv(r)
        inner = q.conj().swapaxes(1, 2) @ data
        residual = data - q @ inner
        found.append((inverse @ inner)[:, :n_w].swapaxes(1, 2))
        cross.append(np.einsum("fka,fkb->fab", residual, residual.conj()) / dof)
        gain.append((inverse @ inverse.conj().swapaxes(1, 2))[:, :n_w, :n_w].conj())
    return np.concatenate(found), np.concatenate(cross), np.concatenate(gain)


def _divide(
    joint: ComplexArray, cross: ComplexArray, gain: ComplexArray, n_u: int
) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Return G = G_yr G_ur^-1 with the covariance of y - G u and the gain that belongs to it."""
    inverse = np.linalg.inv(joint[:, :n_u])
    g = joint[:, n_u:] @ inverse
    mix = np.concatenate([-g, np.broadcast_to(np.eye(g.shape[1]), (g.shape[0], g.shape[1], g.shape[1]))], axis=2)
    cross = mix @ cross @ mix.conj().swapaxes(1, 2)
    return g, cross, inverse.conj().swapaxes(1, 2) @ gain @ inverse


def frequency_response_welch(
    inputs: Array, outputs: Array, rate_hz: float, segment: int, *, reference: Array | None = None
) -> FrequencyResponse:
    """Return the averaged (H1) response of a long record from half-overlapping Hann segments of `segment` samples.

    Shapes as in `frequency_response_local`. Leakage biases sharp resonances; use local polynomials where that matters.
    Neighbouring lines are correlated by the window. Raises DataError when there are too few segments.
    """
    _checked(inputs, outputs, reference)
    n, n_u = inputs.shape
    count = (n - segment) // (segment // 2) + 1 if segment >= 8 else 0
    if count < n_u + 2:
        raise DataError(
            f"{n} samples give {max(count, 0)} segments of {segment}; {n_u} inputs need {n_u + 2} of 8 samples or more"
        )
    record = np.concatenate([inputs, outputs, *(() if reference is None else (reference,))], axis=1)
    spectra = averaged_spectra([[record]], segment, record.shape[1], record.mean(axis=0))
    return spectra.response(rate_hz, n_u, outputs.shape[1])
