"""Three-parameter sine fit (IEEE Std 1057-2017, section 4.6) of every segment of a stepped-sine record at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_backend.errors import ConfigError, DataError
from sim_backend.linear import Array
from sim_backend.readings import first_absurd, said

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True)
class SineFit:
    """Least-squares sines, x(t) = Re(phasor e^{i 2 pi f t}) + offset with t = 0 at the record's first sample.

    Shapes: `frequency_hz` (n_s,); `phasor`, `offset`, `noise_std` (n_s, n_c); `covariance` (n_s, n_c, 3, 3) of (real
    part, imaginary part, offset). `noise_std` is that of one sample, for noise as strong at all frequencies as it is
    around the fitted one.
    """

    frequency_hz: Array
    phasor: ComplexArray
    offset: Array
    noise_std: Array
    covariance: Array

    @property
    def amplitude(self) -> Array:
        """Amplitudes (n_s, n_c), in units of the record."""
        return np.abs(self.phasor)

    @property
    def phase_rad(self) -> Array:
        """Phases (n_s, n_c), rad, of the cosine at the record's first sample."""
        return np.angle(self.phasor)

    @property
    def variance(self) -> Array:
        """E|error|² of the phasors (n_s, n_c)."""
        return self.covariance[:, :, 0, 0] + self.covariance[:, :, 1, 1]

    def channel(self, i: int) -> SineFit:
        """Return the fit of one channel alone."""
        own = slice(i, i + 1)
        parts = (self.phasor[:, own], self.offset[:, own], self.noise_std[:, own], self.covariance[:, own])
        return SineFit(self.frequency_hz, *parts)


def joined(fits: Sequence[SineFit]) -> SineFit:
    """Return the fits of consecutive parts of a record, whose phases count from the same sample, as one."""
    names = ("frequency_hz", "phasor", "offset", "noise_std", "covariance")
    return SineFit(*(np.concatenate([getattr(fit, name) for fit in fits]) for name in names))


@dataclass(frozen=True)
class SineResponse:
    """Response at each frequency: `response`, `variance` (E|error|²), (n_f, n_y, n_u), with what a plot needs."""

    frequency_hz: Array
    response: ComplexArray
    variance: Array

    @property
    def magnitude_std(self) -> Array:
        """Standard deviation of the magnitude (n_f, n_y, n_u)."""
        return np.sqrt(0.5 * self.variance)

    @property
    def phase_std_rad(self) -> Array:
        """Standard deviation of the phase (n_f, n_y, n_u), rad."""
        return np.sqrt(0.5 * self.variance) / np.abs(self.response)


def fit_sines(
    record: Array,
    rate_hz: float,
    start: NDArray[np.intp],
    stop: NDArray[np.intp],
    frequency_hz: Array,
    noise_lines: int = 4,
    first_sample: int = 0,
) -> SineFit:
    """Return the fit of one sine of known frequency to each segment [start, stop) of a record.

    Shapes: `record` (n, n_c); `start`, `stop`, `frequency_hz` (n_s,), segments in order and apart; they should hold
    the steady state only. The noise is measured `noise_lines` lines to either side of each sine, so that coloured
    noise gives the right uncertainty; with 0 it is the rms of the residual (white noise). Phases count from
    `first_sample` before the record's first sample, for a record that is a part of a longer one. Raises ConfigError for
    segments that overlap or leave the record, DataError when a segment is too short.
    """
    start, stop = np.asarray(start, dtype=np.intp), np.asarray(stop, dtype=np.intp)
    frequency = np.asarray(frequency_hz, dtype=float)
    _check(record, rate_hz, start, stop, frequency, noise_lines)
    length = stop - start
    inside = np.concatenate([np.arange(a, b) for a, b in zip(start, stop, strict=True)])
    first = np.concatenate([[0], np.cumsum(length)[:-1]])
    # phases run from each segment's first sample, where they are small and exact, and are shifted back at the end
    local = inside - np.repeat(start, length)
    data = record[inside]
    _require_readings(data, local, length, frequency)
    centre = _sums(data, first) / length[:, None]
    data = data - np.repeat(centre, length, axis=0)

    def turning(cycles: Array) -> ComplexArray:
        return np.exp(2j * np.pi * np.mod(np.repeat(cycles, length) * local, 1.0))

    carrier = turning(frequency / rate_hz)
    design = np.stack([carrier.real, -carrier.imag, np.ones(local.size)], axis=1)
    products = design[:, :, None] * design[:, None, :]
    inverse = np.linalg.inv(np.add.reduceat(products, first, axis=0))

    def solved(x: Array) -> tuple[Array, Array]:
        one = inverse @ np.add.reduceat(design[:, :, None] * x[:, None, :], first, axis=0)
        return one, x - np.einsum("ti,tic->tc", design, np.repeat(one, length, axis=0))

    # column by column: what one channel gives does not depend, to the last digit, on what is fitted beside it
    columns = [solved(data[:, [i]]) for i in range(data.shape[1])]
    found, residual = np.concatenate([c[0] for c in columns], axis=2), np.concatenate([c[1] for c in columns], axis=1)
    noise = _sums(residual**2, first) / (length - 3)[:, None]
    if noise_lines:
        noise = _local_noise(residual, turning, first, length, frequency / rate_hz, noise_lines)
    back = np.exp(-2j * np.pi * np.mod(frequency / rate_hz * (start + first_sample), 1.0))
    return SineFit(
        frequency,
        (found[:, 0] + 1j * found[:, 1]) * back[:, None],
        found[:, 2] + centre,
        np.sqrt(noise),
        noise[:, :, None, None] * inverse[:, None],
    )


def _check(
    record: Array, rate_hz: float, start: NDArray[np.intp], stop: NDArray[np.intp], frequency: Array, lines: int
) -> None:
    """Refuse segments that cannot be fitted."""
    if record.ndim != 2 or not start.size == stop.size == frequency.size or start.size == 0:
        raise ConfigError(
            f"{start.size} starts, {stop.size} stops and {frequency.size} frequencies; needs one of each per segment"
        )
    if start[0] < 0 or stop[-1] > record.shape[0] or np.any(start[1:] < stop[:-1]):
        raise ConfigError(
            f"segments overlap or leave the record of {record.shape[0]} samples; give them in order and apart"
        )
    if np.any(frequency <= 0.0) or np.any(frequency >= 0.5 * rate_hz):
        bad = frequency[np.argmax((frequency <= 0.0) | (frequency >= 0.5 * rate_hz))]
        raise ConfigError(
            f"sine of {bad} Hz in a record at {rate_hz} Hz; needs a frequency between 0 and half the rate"
        )
    need = np.maximum(4 + 2 * lines, rate_hz / frequency)
    if np.any(stop - start < need):
        worst = int(np.argmax(need - (stop - start)))
        has, wants = stop[worst] - start[worst], int(np.ceil(need[worst]))
        raise DataError(
            f"segment {worst} at {frequency[worst]} Hz has {has} samples; needs at least {wants}, one period"
        )


def _require_readings(data: Array, local: NDArray[np.intp], length: NDArray[np.intp], frequency: Array) -> None:
    """Refuse values that no sensor reads, with the position of the first."""
    if (absurd := first_absurd(data)) is not None:
        at = int(np.searchsorted(np.cumsum(length), absurd[0], side="right"))
        raise DataError(
            f"segment {at} at {frequency[at]} Hz: sample {int(local[absurd[0]])} of channel {absurd[1]} is "
            f"{said(data[absurd])}; leave that segment out, or record it again"
        )


def _sums(values: Any, first: NDArray[np.intp]) -> Any:
    """Return the sums (n_s, n_c) over segments that begin at `first`, column by column."""
    return np.concatenate([np.add.reduceat(values[:, [i]], first, axis=0) for i in range(values.shape[1])], axis=1)


def _local_noise(
    residual: Array,
    turning: Callable[[Array], ComplexArray],
    first: NDArray[np.intp],
    length: NDArray[np.intp],
    cycles: Array,
    lines: int,
) -> Array:
    """Return the variance of one sample (n_s, n_c) if the noise were as strong everywhere as beside the sine.

    The residual is projected on the segment's own lines k = 1 … `lines` to either side; those that would fall below
    0 Hz or above half the rate fold back onto other valid lines. The sine's own line is left out: the fit emptied it.
    """
    power = np.zeros((first.size, residual.shape[1]))
    count = np.zeros((first.size, 1))
    for k in (*range(-lines, 0), *range(1, lines + 1)):
        near = cycles + k / length
        valid = (near > 0.5 / length) & (near < 0.5 - 0.5 / length)
        line = _sums(turning(-near)[:, None] * residual, first)
        power += np.where(valid[:, None], np.abs(line) ** 2, 0.0)
        count += valid[:, None]
    return power / count / length[:, None]


def sine_response(inputs: SineFit, outputs: SineFit) -> SineResponse:
    """Return the response from fits of the same segments' inputs and outputs, noise in both counted.

    With one input each segment gives one point, and repeated frequencies stay apart. With several inputs each
    frequency needs as many consecutive segments as there are inputs, driven independently; they are solved together.
    Raises ConfigError when they are not there.
    """
    n_u = inputs.phasor.shape[1]
    f = inputs.frequency_hz
    if f.size % n_u or np.any(f.reshape(-1, n_u) != f.reshape(-1, n_u)[:, :1]):
        raise ConfigError(
            f"{f.size} segments do not come in groups of {n_u} with one frequency; play each frequency once per input"
        )
    group = (f.size // n_u, n_u)
    u, y = (fit.phasor.reshape(*group, -1).swapaxes(1, 2) for fit in (inputs, outputs))
    noise_u, noise_y = (fit.variance.reshape(*group, -1).swapaxes(1, 2) for fit in (inputs, outputs))
    if np.any(np.linalg.cond(u) > 1e6):
        worst = f[::n_u][int(np.argmax(np.linalg.cond(u)))]
        raise DataError(
            f"the segments at {worst} Hz do not drive the {n_u} inputs independently; drive one input at a time"
        )
    inverse = np.linalg.inv(u)
    g = y @ inverse
    # error of G = (error of Y - G error of U) U^-1, experiment by experiment
    misfit = noise_y + np.abs(g) ** 2 @ noise_u
    return SineResponse(f[::n_u].copy(), g, misfit @ np.abs(inverse) ** 2)
