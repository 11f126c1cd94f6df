"""The spectrum of what does not repeat, and how likely it is under a smooth floor with a random torque on top.

What no model predicts is what does not repeat: of repeated periods the differences (orthonormal contrasts, so that they
are independent), of all else the residual. The whitening filter keeps its spectrum from leaking, and the filter's gain
is divided out again. The likelihood is Whittle's (1953), in bins of ordinates of the cosine transform.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from analysis.diagnosis.fitting.fit import Setting
from analysis.diagnosis.noise.whitener import band_of, runs_of
from analysis.diagnosis.records.dataset import Record
from sim_backend.linear import Array, ModalModel

_GROWTH, _LEAST_ROWS = 1.03, 8
"""Ratio of the edges of a bin, and how many numbers it holds at least."""

_STEPS = 60
"""Steps of the search for the largest likelihood at most."""

_CYCLES, _HIGHEST = 4.0, 0.45
"""Frequencies are used from so many half waves in a series to this part of the sample rate."""


Start = tuple[int, float, float, bool, float]
"""Where the fit of a band starts: input, centre, width, whether its flanks are steep, and its power.

A centre of zero stays there: a low pass, half as wide as the width. An infinite width stays as well: white."""


@dataclass(frozen=True)
class Spectrum:
    """The mean power (n_y, k) of the residual in bins of `count` (k,) numbers at `frequency_hz` (k, points)."""

    frequency_hz: Array
    power: Array
    count: Array

    @property
    def edges_hz(self) -> Array:
        """Edges of the bins, shape (k + 1,): points are the middles of equal parts of a bin."""
        half = 0.5 * (self.frequency_hz[:, 1] - self.frequency_hz[:, 0])
        return np.append(self.frequency_hz[:, 0] - half, self.frequency_hz[-1, -1] + half[-1])


@dataclass(frozen=True)
class Band:
    """A random torque at input number `input`: its standard deviation and where its power lies.

    An infinite width is all frequencies alike, a centre of zero a low pass. `std` are the standard deviations of rms,
    centre and width, zero of what is not fitted.
    """

    input: int
    rms: float
    centre_hz: float
    width_hz: float
    steep: bool
    std: tuple[float, float, float]
    log_likelihood: float
    terms: int

    @property
    def low_pass(self) -> bool:
        """Whether it is strongest at the lowest frequencies, or as strong at all: the noise of an amplifier."""
        return math.isinf(self.width_hz) or self.centre_hz == 0.0


def resonator(frequency_hz: Array, centre_hz: float, width_hz: float, steep: bool) -> Array:
    """Return the one-sided spectrum (1/Hz) of a resonator's output of unit variance, shape of `frequency_hz`.

    Its flanks fall with the square of the distance or, `steep`, with the fourth power of the frequency, as those of a
    mass on a spring under white noise do. How it is done in nature nobody knows; the better one counts.
    """
    half = 0.5 * width_hz
    below, above = (frequency_hz - centre_hz) ** 2 + half**2, (frequency_hz + centre_hz) ** 2 + half**2
    if steep:
        return np.asarray(4.0 * half * (centre_hz**2 + half**2) / (np.pi * below * above))
    return np.asarray(half / np.pi * (1.0 / below + 1.0 / above))


class Series(NamedTuple):
    """Rows that hold noise, whitened (m, n_y), and how much was played: `motion` (m,).

    That is the squared input in units of its mean square, summed over the inputs. Where periods repeat the rows are
    noise `alone`; elsewhere they are what a model leaves.
    """

    rows: Array
    motion: Array
    alone: bool


def series_of(setting: Setting, record: Record, white: Array) -> list[Series]:
    """Return what does not repeat in the fitted rows of `white` (n, n_y)."""
    size = np.maximum(setting.data.u_scale(), np.finfo(float).tiny)
    motion = np.sum((record.u / size) ** 2, axis=1)
    out = []
    for w in record.windows:
        if w.held_out:
            continue
        start = max(w.start, setting.whitener.order)
        begin, count = w.repeated
        if count < 2:
            mask = np.zeros(record.n, dtype=bool)
            mask[start : w.stop] = True
            out += [Series(white[a:b], motion[a:b], False) for a, b in runs_of(mask)]
            continue
        periods = white[begin : begin + count * w.period].reshape(count, w.period, -1)
        played = motion[begin : begin + w.period]
        out += [Series(np.tensordot(row, periods, axes=1), played, True) for row in scipy.linalg.helmert(count)]
    return out


def spectrum_of(setting: Setting, series: Sequence[Array]) -> Spectrum | None:
    """Return the residual's spectrum from whitened series (m, n_y); None when there is too little for one."""
    rate = setting.data.rate_hz
    parts, powers = [], []
    for x in series:
        f = np.arange(x.shape[0]) / (2.0 * x.shape[0])
        used = (f >= _CYCLES / (2.0 * x.shape[0])) & (f <= _HIGHEST)
        parts.append(f[used])
        powers.append((scipy.fft.dct(x, axis=0, norm="ortho") ** 2)[used])
    frequency = np.concatenate(parts) if parts else np.zeros(0)
    if frequency.size < 32 * _LEAST_ROWS:
        return None
    line = np.exp(-2j * np.pi * np.outer(frequency, np.arange(setting.whitener.order + 1)))
    power = np.concatenate(powers) / np.abs(line @ setting.whitener.taps.T) ** 2
    ordered = np.sort(frequency)
    edges, at = [float(ordered[0])], 0
    while at + 2 * _LEAST_ROWS < ordered.size:
        at = max(at + _LEAST_ROWS, int(np.searchsorted(ordered, edges[-1] * _GROWTH)))
        if at + _LEAST_ROWS > ordered.size:
            break
        edges.append(float(ordered[at]))
    edges.append(float(np.nextafter(ordered[-1], np.inf)))
    low, high = np.array(edges[:-1]), np.array(edges[1:])
    band = band_of(np.array(edges), frequency)
    number = np.bincount(band, minlength=low.size)
    means = np.stack([np.bincount(band, p, low.size) / np.maximum(number, 1) for p in power.T])
    inside = (np.arange(5) + 0.5) / 5.0
    points = low[:, None] + (high - low)[:, None] * inside
    kept = number > 0
    return Spectrum(points[kept] * rate, means[:, kept], number[kept].astype(float))


@dataclass(frozen=True)
class Whittle:
    """The likelihood of a spectrum: each output's floor exp(basis θ), and on it a torque's power through the plant.

    `gain` (n_y, n_u, k, points) are the squared gains of the plant.
    """

    spectrum: Spectrum
    gain: Array
    rate_hz: float

    @classmethod
    def of(cls, spectrum: Spectrum, linear: ModalModel, rate_hz: float) -> Whittle:
        """Return the likelihood of `spectrum` for torques through `linear`."""
        f = spectrum.frequency_hz
        response = np.abs(linear.frequency_response(f.ravel())) ** 2
        return cls(spectrum, np.moveaxis(response.reshape(*f.shape, *response.shape[1:]), (0, 1), (2, 3)), rate_hz)

    def hump(self, j: int, centre_hz: float, width_hz: float, steep: bool) -> Array:
        """Return the power (n_y, k) that a torque of unit variance adds."""
        if math.isinf(width_hz):
            return np.asarray(self.gain[:, j].mean(axis=2))
        shape = 0.5 * self.rate_hz * resonator(self.spectrum.frequency_hz, centre_hz, width_hz, steep)
        return np.asarray((self.gain[:, j] * shape).mean(axis=2))

    def loss(self, model: Array) -> float:
        """Return minus the log-likelihood of a spectrum `model` (n_y, k)."""
        return 0.5 * float(np.sum(self.spectrum.count * (np.log(model) + self.spectrum.power / model)))

    def floor(self, terms: int) -> tuple[Array, float]:
        """Return the floor (n_y, k) of so many terms and its log-likelihood."""
        basis = self._basis(terms)
        theta = np.asarray(np.linalg.lstsq(basis, np.log(self.spectrum.power).T, rcond=None)[0].T, dtype=float)

        def model(x: Array) -> tuple[Array, Array]:
            floor = np.exp(x.reshape(theta.shape) @ basis.T)
            return floor, self._floor_slopes(floor, basis)

        x, loss, _ = self._descend(model, theta.ravel())
        return model(x)[0], -loss

    def band(self, terms: int, start: Start, floor: Array) -> Band | None:
        """Return the best band from a start, over a floor of so many terms that starts at `floor`."""
        j, centre_hz, width_hz, steep, power = start
        basis = self._basis(terms)
        theta = np.linalg.lstsq(basis, np.log(floor).T, rcond=None)[0].T
        low, top = float(self.spectrum.frequency_hz[0, 0]), self.rate_hz * _HIGHEST
        ends = math.log(0.1 * low), math.log(top)
        free = [] if math.isinf(width_hz) else [1] if centre_hz == 0.0 else [0, 1]

        def parts(x: Array) -> tuple[float, float]:
            if not free:
                return top, math.inf
            found = [centre_hz, width_hz]
            for k, value in zip(free, x[theta.size + 1 :], strict=True):
                found[k] = math.exp(np.clip(value, *ends))
            return found[0], found[1]

        def model(x: Array) -> tuple[Array, Array]:
            under = np.exp(np.clip(x[: theta.size].reshape(theta.shape) @ basis.T, -700.0, 700.0))
            variance = math.exp(min(x[theta.size], 300.0))
            hump = variance * self.hump(j, *parts(x), steep)
            slopes = [self._floor_slopes(under, basis), hump[:, :, None]]
            for k in range(theta.size + 1, x.size):
                there = x.copy()
                there[k] += 1e-4
                slopes.append(((variance * self.hump(j, *parts(there), steep) - hump) / 1e-4)[:, :, None])
            return under + hump, np.concatenate(slopes, axis=2)

        own = [math.log(power), *(math.log((centre_hz, width_hz)[k]) for k in free)]
        x, loss, covariance = self._descend(model, np.concatenate([theta.ravel(), own]))
        deviation = np.sqrt(np.maximum(np.diag(covariance)[theta.size :], 0.0))
        rms = math.exp(0.5 * x[theta.size])
        centre, width = parts(x)
        if not np.isfinite(loss):
            return None
        std = [0.5 * rms * float(deviation[0]), 0.0, 0.0]
        for k, relative in zip(free, deviation[1:], strict=True):
            std[1 + k] = float(relative) * (centre, width)[k]
        return Band(j, rms, centre, width, steep, (std[0], std[1], std[2]), -loss, terms)

    def strength(self, band: Band) -> tuple[float, float]:
        """Return the factor by which this spectrum shows the power of `band`, and its standard deviation."""
        basis = self._basis(band.terms)
        hump = band.rms**2 * self.hump(band.input, band.centre_hz, band.width_hz, band.steep)
        theta = np.asarray(np.linalg.lstsq(basis, np.log(self.spectrum.power).T, rcond=None)[0].T, dtype=float)

        def model(x: Array) -> tuple[Array, Array]:
            under = np.exp(np.clip(x[:-1].reshape(theta.shape) @ basis.T, -700.0, 700.0))
            slope = math.exp(x[-1]) * hump
            return under + slope, np.concatenate([self._floor_slopes(under, basis), slope[:, :, None]], axis=2)

        x, _, covariance = self._descend(model, np.append(theta.ravel(), math.log(0.5)))
        factor = math.exp(x[-1])
        return factor, factor * math.sqrt(max(float(covariance[-1, -1]), 0.0))

    def _basis(self, terms: int) -> Array:
        at = np.log(self.spectrum.frequency_hz.mean(axis=1))
        return np.polynomial.chebyshev.chebvander(2.0 * (at - at[0]) / (at[-1] - at[0]) - 1.0, terms - 1)

    def _floor_slopes(self, floor: Array, basis: Array) -> Array:
        """Return d floor / dθ, shape (n_y, k, n_y · terms)."""
        n_y, k = floor.shape
        out = np.zeros((n_y, k, n_y, basis.shape[1]))
        for o in range(n_y):
            out[o, :, o] = floor[o][:, None] * basis
        return out.reshape(n_y, k, -1)

    def _descend(self, model: Callable[[Array], tuple[Array, Array]], x: Array) -> tuple[Array, float, Array]:
        """Return the parameters of largest likelihood by damped scoring, the loss there, and their covariance."""
        power, count = self.spectrum.power, self.spectrum.count
        now, slopes = model(x)
        loss, damping = self.loss(now), 1e-3
        information = np.eye(x.size)
        for _ in range(_STEPS):
            relative = (slopes / now[:, :, None]).reshape(-1, x.size)
            weight = np.broadcast_to(0.5 * count, now.shape).ravel()
            information = (relative * weight[:, None]).T @ relative
            gradient = relative.T @ (weight * (power / now - 1.0).ravel())
            own = np.diag(information)
            lift = damping * own + 1e-12 * max(float(own.max()), 1.0)
            step = np.clip(np.linalg.solve(information + np.diag(lift), gradient), -1.0, 1.0)
            then, further = model(x + step)
            after = self.loss(then)
            if after < loss:
                gained, x, now, slopes, loss, damping = loss - after, x + step, then, further, after, 0.2 * damping
                if gained < 1e-6:
                    break
            else:
                damping *= 10.0
                if damping > 1e8:
                    break
        return x, loss, np.asarray(np.linalg.pinv(information, rcond=1e-12), dtype=float)
