"""How well a model's output agrees with a measured one, and whether the residual looks like noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from sim_backend.errors import ConfigError, DataError
from sim_backend.linear import Array


@dataclass(frozen=True)
class RelativeError:
    """rms of the error ÷ rms of the output about its mean: per channel (n_y,) and over all channels together."""

    per_channel: Array
    total: float


def relative_error(measured: Array, modelled: Array) -> RelativeError:
    """Return the relative error of `modelled` against `measured`, both (n, n_y, …).

    Per channel it is averaged over the trailing axes (realisations, periods), each with its own rms, as the published
    results on periodic benchmarks are; the total is the mean over all of them. Raises DataError for a constant channel.
    """
    if measured.shape != modelled.shape or measured.ndim < 2:
        raise ConfigError(
            f"measured {measured.shape} and modelled {modelled.shape} differ; needs (n, channels, …) twice"
        )
    size = np.std(measured, axis=0)
    if np.any(size == 0.0):
        raise DataError(
            f"output channel {int(np.argwhere(size == 0.0)[0][0])} is constant; its relative error has no meaning"
        )
    error = np.sqrt(np.mean((measured - modelled) ** 2, axis=0)) / size
    return RelativeError(error.reshape(error.shape[0], -1).mean(axis=1), float(error.mean()))


@dataclass(frozen=True)
class Whiteness:
    """Correlation of a residual: `autocorrelation` (lags,) at lags 1 …, the Ljung-Box statistic and its p-value."""

    autocorrelation: Array
    statistic: float
    p_value: float


def whiteness(residual: Array, lags: int = 25, fitted: int = 0) -> Whiteness:
    """Return the autocorrelation of a residual (n,) at lags 1 to `lags`, and the test that it is white (Ljung-Box).

    A small p-value says that it is not white. `fitted` noise parameters are taken off its degrees of freedom. Raises
    DataError for fewer than 2 `lags` + 1 samples, and for `lags` that do not exceed `fitted`. Source: Ljung & Box 1978.
    """
    n = residual.size
    if n <= 2 * lags:
        raise DataError(f"the residual has {n} samples, {lags} lags need more than {2 * lags}; give fewer lags")
    if lags <= fitted:
        raise DataError(f"lags is {lags} with {fitted} fitted noise parameters; give more lags than parameters")
    rho = _correlation(residual, residual, lags)[1:]
    statistic = float(n * (n + 2) * np.sum(rho**2 / (n - np.arange(1, lags + 1))))
    return Whiteness(rho, statistic, float(scipy.stats.chi2.sf(statistic, lags - fitted)))


@dataclass(frozen=True)
class InputCorrelation:
    """Correlation of a residual with an input at lags 0 … (lags + 1,), the statistic and its p-value."""

    correlation: Array
    statistic: float
    p_value: float


def input_correlation(residual: Array, u: Array, lags: int = 25) -> InputCorrelation:
    """Return the correlation of a residual (n,) with an input (n,) at lags 0 to `lags`, and the test that it is zero.

    A small p-value says that the input explains some of the residual. Each correlation's variance follows from both
    autocorrelations (Bartlett), so neither needs to be white; under independence the statistic is chi2 with lags + 1
    degrees of freedom. Raises DataError for unequal lengths, and for fewer than 4 `lags` + 1 samples.
    """
    n = residual.size
    if u.shape != residual.shape or n <= 4 * lags:
        raise DataError(
            f"the residual has the shape {residual.shape}, the input {u.shape}; {lags} lags need equal lengths above "
            f"{4 * lags}: give the input of the same samples, or fewer lags"
        )
    cross = _correlation(residual, u, lags)
    reach = min(n - 1, max(10 * lags, 100))
    auto_r, auto_u = _correlation(residual, residual, reach + lags), _correlation(u, u, reach + lags)
    # covariance of the correlations at lags i and j depends on i - j alone
    shift = np.arange(-reach, reach + 1)
    spread = np.array([np.sum(auto_r[np.abs(shift)] * auto_u[np.abs(shift + k)]) for k in range(lags + 1)]) / n
    index = np.abs(np.arange(lags + 1)[:, None] - np.arange(lags + 1))
    statistic = float(cross @ np.linalg.lstsq(spread[index], cross, rcond=1e-10)[0])
    return InputCorrelation(cross, statistic, float(scipy.stats.chi2.sf(statistic, lags + 1)))


def _correlation(first: Array, second: Array, lags: int) -> Array:
    """Return the correlation coefficients of first(t) with second(t - k), k = 0 … lags, biased as usual."""
    n = first.size
    a, b = first - first.mean(), second - second.mean()
    size = scipy.fft.next_fast_len(2 * n, real=True)
    product = scipy.fft.irfft(scipy.fft.rfft(a, size) * np.conj(scipy.fft.rfft(b, size)), size)[: lags + 1]
    return product / (n * a.std() * b.std())
