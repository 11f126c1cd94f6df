"""Frequency response of periodic records, with noise and nonlinear distortion separated.

The robust method of Pintelon & Schoukens, "System Identification: A Frequency Domain Approach" (2nd ed. 2012), section
4.3: periods give the noise, realisations of the random phases give the distortion. The response of all experiments at
once is G = (Y W')(U W')^-1 with the instrument W = U, or the reference in a closed loop, where U carries noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.frequency.cross_spectra import ComplexArray, solve_lines
from sim_backend.errors import ConfigError, DataError
from sim_backend.intersample import hold_response
from sim_backend.linear import Array


@dataclass(frozen=True)
class FrequencyResponse:
    """A measured response with uncertainty at the excited lines.

    Shapes: `frequency_hz` (n_f,); `response` (n_f, n_y, n_u). `noise_variance` and `total_variance` (n_f, n_y, n_u) are
    E|error|² of the response from noise alone, and from noise and distortion together. `output_noise` and
    `output_distortion` (n_f, n_y) are variances of one period's output spectrum, scaled so that their sum over the
    lines is a mean square in output units; `output_power` (n_f, n_y) is the output's own. The distortion is a
    difference of two estimates and may come out below zero at a line: sum or average it over lines first. What the
    record does not determine (noise from one period, distortion without spare realisations) is NaN. `noise_dof` and
    `total_dof` count the complex degrees of freedom behind the variances at each line.
    """

    frequency_hz: Array
    response: ComplexArray
    noise_variance: Array
    total_variance: Array
    output_noise: Array
    output_distortion: Array
    output_power: Array
    noise_dof: int
    total_dof: int

    @property
    def variance(self) -> Array:
        """Variance (n_f, n_y, n_u) to weight by: total, else noise. Raises DataError if neither is known."""
        for known in (self.total_variance, self.noise_variance):
            if np.all(np.isfinite(known)):
                return known
        raise DataError(
            "frequency response has no uncertainty: one period and no spare realisation; record more periods"
        )


def response_to_steps(measured: FrequencyResponse, rate_hz: float, late_samples: Array) -> FrequencyResponse:
    """Return the response to the held steps that stand for the measured band-limited input.

    `late_samples` (n_u,), whole, is the delay of each input, taken out of the response. See `sim_backend.intersample`.
    """
    cycles = measured.frequency_hz / rate_hz
    steps = hold_response(cycles)[:, None, None]
    early = np.exp(2j * np.pi * cycles[:, None, None] * late_samples)
    weaker = np.abs(steps) ** 2
    return replace(
        measured,
        response=measured.response * steps * early,
        noise_variance=measured.noise_variance * weaker,
        total_variance=measured.total_variance * weaker,
    )


def frequency_response_periodic(
    inputs: Array,
    outputs: Array,
    rate_hz: float,
    *,
    reference: Array | None = None,
    drop_periods: int = 0,
    lines: NDArray[np.intp] | None = None,
    excitation_floor: float = 1e-5,
    workers: int = 2,
) -> FrequencyResponse:
    """Return the response of periodic data with its noise and distortion.

    Shapes: `inputs` (n, n_u, realisations, periods), `outputs` (n, n_y, …), `reference` like the inputs, for a closed
    loop. `lines` are the excited bins; without them, those whose input (or reference) power is above
    `excitation_floor` times the strongest. `drop_periods` at the start are left out as transient (see
    `period_drift`). `workers` is the number of threads. Raises DataError when there are fewer realisations than inputs
    or nothing is excited.
    """
    u, y = _checked(inputs, outputs, drop_periods)
    w = None if reference is None else _checked(reference, outputs, drop_periods)[0]
    if w is not None and w.shape[1] != u.shape[1]:
        raise ConfigError(f"reference has {w.shape[1]} channels, input {u.shape[1]}; a closed loop needs one per input")
    uu, yy = _spectra(u, workers), _spectra(y, workers)
    ww = uu if w is None else _spectra(w, workers)
    if lines is None:
        lines = excited_lines(ww, excitation_floor)
    return response_from_spectra(uu, yy, ww, lines, lines * (rate_hz / u.shape[0]), blocked=True, workers=workers)


def _spectra(records: Array, workers: int) -> ComplexArray:
    """Return the spectra (channel, realisation, period, n_f) of records (sample, channel, realisation, period).

    They carry 1 / n, so that a line's power does not depend on the record's length.
    """
    return np.asarray(scipy.fft.rfft(np.moveaxis(records, 0, -1), norm="forward", workers=workers))


def _checked(first: Array, outputs: Array, drop: int) -> tuple[Array, Array]:
    """Return the arrays without the dropped periods, or say what does not fit."""
    if first.ndim != 4 or outputs.ndim != 4:
        raise ConfigError(
            f"records have {first.ndim} and {outputs.ndim} dimensions; needs (sample, channel, realisation, period)"
        )
    if first.shape[0] != outputs.shape[0] or first.shape[2:] != outputs.shape[2:]:
        raise ConfigError(
            f"input {first.shape} and output {outputs.shape} (sample, channel, realisation, period) differ in more "
            "than their channels; give the same samples, realisations and periods of both"
        )
    if drop < 0 or drop >= first.shape[3]:
        raise ConfigError(f"{drop} of {first.shape[3]} periods are to be dropped; leave at least one")
    if first.shape[2] < first.shape[1]:
        raise DataError(
            f"{first.shape[2]} realisations cannot separate {first.shape[1]} inputs; record at least as many"
        )
    return first[..., drop:], outputs[..., drop:]


def excited_lines(spectrum: ComplexArray, floor: float) -> NDArray[np.intp]:
    """Return the bins (k,) whose mean power is above `floor` times that of the strongest, no 0 Hz or half the rate.

    `spectrum` is (channel, realisation, period, n_f). Raises DataError when no bin has any power.
    """
    first = spectrum[:, :, 0]
    power = np.mean(first.real**2 + first.imag**2, axis=(0, 1))
    power[0] = power[-1] = 0.0
    lines = np.flatnonzero(power > floor * power.max())
    if power.max() == 0.0 or lines.size == 0:
        raise DataError("input is constant in every realisation; there is nothing to measure a response with")
    return lines


def response_from_spectra(
    u: ComplexArray,
    y: ComplexArray,
    w: ComplexArray,
    lines: NDArray[np.intp],
    frequency_hz: Array,
    blocked: bool,
    workers: int = 2,
) -> FrequencyResponse:
    """Return the response from spectra (channel, experiment, period, n_f) at `lines`, with instrument `w`.

    If `blocked`, and with two or more whole blocks of n_u experiments that each separate the inputs by themselves
    (orthogonal multisines), the total variance is the scatter of the blocks' responses; otherwise the experiments count
    as independent. Raises DataError when the experiments do not separate the inputs at some line.
    """
    n_u, experiments, periods = u.shape[:3]
    blocks = experiments // n_u if n_u > 1 and experiments % n_u == 0 and blocked else 0
    lines = np.ascontiguousarray(lines)
    g, gain, (scatter, misfit, power), spread, good = solve_lines(u, y, w, lines, w is u, blocks > 1, workers)
    if blocks > 1 and not np.all(good):
        blocks = 0
        g, gain, (scatter, misfit, power), spread, good = solve_lines(u, y, w, lines, w is u, False, workers)
    if not np.all(good):
        bad = frequency_hz[int(np.argmin(good))]
        raise DataError(
            f"the {experiments} experiments do not separate the {n_u} inputs at {bad:.6g} Hz; excite them independently"
        )
    noise_dof, total_dof = (periods - 1) * experiments, experiments - n_u
    # of one period, and of the mean over periods
    noise = scatter / noise_dof if noise_dof > 0 else np.full(scatter.shape, np.nan)
    total = misfit / total_dof if total_dof > 0 else np.full(scatter.shape, np.nan)
    # a line and its mirror image below 0 Hz both carry power
    return FrequencyResponse(
        frequency_hz,
        g,
        (noise / periods)[:, :, None] * gain[:, None, :],
        spread / (blocks * (blocks - 1)) if blocks > 1 else total[:, :, None] * gain[:, None, :],
        2.0 * noise,
        2.0 * (total - noise / periods),
        2.0 * power / experiments,
        noise_dof,
        blocks - 1 if blocks > 1 else total_dof,
    )


def smoothed(variance: Array, half_width: int) -> Array:
    """Return a variance (n_f, …) averaged over 2 half_width + 1 lines, fewer at the ends.

    A variance from few degrees of freedom makes a poor weight (its reciprocal has no mean below two); noise and
    distortion change slowly over frequency, so neighbours may be pooled.
    """
    total = np.cumsum(np.concatenate([np.zeros((1, *variance.shape[1:])), variance]), axis=0)
    n = variance.shape[0]
    low, high = np.maximum(np.arange(n) - half_width, 0), np.minimum(np.arange(n) + half_width + 1, n)
    return (total[high] - total[low]) / (high - low).reshape(-1, *[1] * (variance.ndim - 1))


def period_drift(signal: Array) -> Array:
    """Return rms difference of each period to the last ÷ rms of the last, (channel, realisation, period - 1).

    `signal` is (n, channel, realisation, period). A transient shows as values that fall from period to period.
    """
    if signal.shape[3] < 2:
        raise DataError("one period only; a transient cannot be distinguished from the response")
    last = signal[..., -1:]
    size = np.std(last, axis=0)
    return np.sqrt(np.mean((signal[..., :-1] - last) ** 2, axis=0)) / size
