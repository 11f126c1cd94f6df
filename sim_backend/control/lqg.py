"""Feedback of least variance against measured noise: linear-quadratic Gaussian control with an integrator.

The plant is driven by a torque disturbance of first order (the amplifiers') and by a slow drift, and read with white
noise. A Kalman filter estimates plant, disturbance and drift, from the newest reading on; the regulator cancels what
it estimates of both torques and returns the plant to rest. Because the drift never dies out, the controller has a
pole at z = 1, an integrator. Two numbers trade variance for robustness: `effort` limits the regulator, `distrust`
tells the filter of a white torque that is not there, which recovers margins at the plant's input (Doyle and Stein,
IEEE Transactions on Automatic Control 24, 1979).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from sim_backend.control.blocks import DiscreteFilter, filter_from_state_space
from sim_backend.control.inversion import siso_matrices
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel, discretise

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

DRIFT = 0.03
"""Steps of the drift per sample, in standard deviations of the disturbance: it sets how fast the integrator is."""

_NO_DRIFT = 1e-5
_DOUBLINGS = 11  # the first 2048 samples of a plant's impulse response show the size of its states


@dataclass(frozen=True)
class Noise:
    """The disturbances of one axis, as standard deviations.

    A torque `torque_nm` within `bandwidth_hz` (first order), and the white noise of one reading, `reading_rad`. Raises
    ConfigError when one is not a finite number above zero.
    """

    torque_nm: float
    bandwidth_hz: float
    reading_rad: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value > 0.0):
                raise ConfigError(f"noise: {name} is {value}; it must be a finite number above zero")

    def forget(self, rate_hz: float) -> float:
        """Return by how much the disturbance shrinks from one sample to the next."""
        return float(np.exp(-2.0 * np.pi * self.bandwidth_hz / rate_hz))

    def colour(self, frequency_hz: ArrayLike, rate_hz: float) -> Array:
        """Return the magnitude (n_f,) by which the disturbance's spectrum differs from that of white noise."""
        a = self.forget(rate_hz)
        z = np.exp(2j * np.pi * np.asarray(frequency_hz, dtype=float) / rate_hz)
        return np.asarray(np.sqrt(1.0 - a**2) / np.abs(1.0 - a / z))


class LinearQuadraticGaussian:
    """The controllers, output per error, of one plant and noise: each regulator and each estimator is solved once.

    The plant has one input and one output. Raises as `siso_matrices`.
    """

    def __init__(self, plant: ModalModel, noise: Noise, rate_hz: float) -> None:
        self._a, self._b, self._c = _in_units_of(noise, *siso_matrices(discretise(plant, rate_hz)))
        self._noise, self._rate_hz = noise, rate_hz
        self._estimators: dict[float, tuple[Array, Array, Array]] = {}
        self._regulators: dict[float, Array] = {}

    def controller(self, effort_rad_nm: float, distrust: float) -> DiscreteFilter:
        """Return the controller of two weights.

        The regulator weighs a torque of 1 N m like an error of `effort_rad_nm` rad; `distrust` is the fictitious white
        torque in units of `noise.torque_nm`. Raises ConfigError when the Riccati equations have no solution.
        """
        whole, seen, blend = self._estimator(distrust)
        full = np.hstack([self._regulator(effort_rad_nm), np.ones((1, 2))])
        # estimate from the newest reading: x+ = x + blend (y - C x); u = -full x+; the filter sees the error -y
        correct = np.eye(whole.shape[0]) - blend @ seen
        step = whole - np.vstack([self._b, np.zeros((2, 1))]) @ full
        out, in_ = self._noise.torque_nm, 1.0 / self._noise.reading_rad
        return filter_from_state_space(
            step @ correct, -step @ blend * in_, -full @ correct * out, full @ blend * out * in_, self._rate_hz
        )

    def innovation_rad(self) -> float:
        """Return the standard deviation of what the best estimate from all earlier readings leaves of the next one."""
        # a drift that is all but none: the plant, not the drift, decides
        _, seen, spread = self._spread(0.0, _NO_DRIFT)
        return self._noise.reading_rad * float(np.sqrt((seen @ spread @ seen.T)[0, 0] + 1.0))

    def _estimator(self, distrust: float) -> tuple[Array, Array, Array]:
        """Return transition, output and gain of the Kalman filter of plant, disturbance and drift."""
        if distrust not in self._estimators:
            whole, seen, spread = self._spread(distrust, DRIFT)
            self._estimators[distrust] = whole, seen, spread @ seen.T / (seen @ spread @ seen.T + 1.0)
        return self._estimators[distrust]

    def _spread(self, distrust: float, drift: float) -> tuple[Array, Array, Array]:
        whole, seen, driven = _with_disturbance(self._noise, self._a, self._b, self._c, distrust, drift, self._rate_hz)
        return whole, seen, _riccati(whole.T, seen.T, driven, np.eye(1))

    def _regulator(self, effort_rad_nm: float) -> Array:
        if effort_rad_nm not in self._regulators:
            a, b, c = self._a, self._b, self._c
            effort = np.eye(1) * (effort_rad_nm * self._noise.torque_nm / self._noise.reading_rad) ** 2
            cost = _riccati(a, b, c.T @ c, effort)
            self._regulators[effort_rad_nm] = np.asarray(
                np.linalg.solve(b.T @ cost @ b + effort, b.T @ cost @ a), float
            )
        return self._regulators[effort_rad_nm]


def least_reading_rad(plant: ModalModel, noise: Noise, rate_hz: float) -> float:
    """Return a standard deviation (rad) of the reading below which no linear feedback of the reading can bring it.

    It is that of the innovation. Source: K. J. Åström, Introduction to Stochastic Control Theory (1970), minimum
    variance control. Raises as `LinearQuadraticGaussian`.
    """
    return LinearQuadraticGaussian(plant, noise, rate_hz).innovation_rad()


def _with_disturbance(
    noise: Noise, a: Array, b: Array, c: Array, distrust: float, drift: float, rate_hz: float
) -> tuple[Array, Array, Array]:
    """Return transition, output and driving covariance of a plant with its disturbance and a drift as states."""
    n, forget = a.shape[0], noise.forget(rate_hz)
    whole = np.zeros((n + 2, n + 2))
    whole[:n, :n], whole[:n, n:], whole[n, n], whole[n + 1, n + 1] = a, b, forget, 1.0
    driven = np.zeros((n + 2, n + 2))
    driven[:n, :n] = distrust**2 * (b @ b.T)
    driven[n, n], driven[n + 1, n + 1] = 1.0 - forget**2, drift**2
    return whole, np.hstack([c, np.zeros((1, 2))]), driven


def _riccati(a: Array, b: Array, q: Array, r: Array) -> Array:
    try:
        return np.asarray(scipy.linalg.solve_discrete_are(a, b, q, r))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise ConfigError(f"feedback: a Riccati equation has no solution ({error}); use another model") from None


def _in_units_of(noise: Noise, a: Array, b: Array, c: Array) -> tuple[Array, Array, Array]:
    """Return a plant from torques and to readings in units of their noise, its states scaled by their motion.

    In SI its numbers lie ten powers of ten apart, and rounding then finds no solution of the Riccati equations.
    """
    answer, ahead = b * noise.torque_nm, a
    for _ in range(_DOUBLINGS):  # [b, A b], then A² times both, and so on
        answer, ahead = np.hstack([answer, ahead @ answer]), ahead @ ahead
    reached = np.sum(answer**2, axis=1)
    size = np.sqrt(np.where(reached > 0.0, reached, 1.0))
    return a * size / size[:, None], b * noise.torque_nm / size[:, None], c * size / noise.reading_rad


def reading_spectrum(
    frequency_hz: ArrayLike, plant: ArrayLike, controller: ArrayLike, noise: Noise, rate_hz: float
) -> tuple[Array, Array]:
    """Return what torque and reading noise each give to the closed loop's reading, as power per sample (..., n_f).

    Its mean over frequencies spread evenly up to half the rate is the variance (Parseval). `plant` (..., n_f) and
    `controller` (n_f,) are sampled responses.
    """
    p, k = np.asarray(plant), np.asarray(controller)
    sensitivity = 1.0 / (1.0 + p * k)
    torque = noise.torque_nm * np.abs(p * sensitivity) * noise.colour(frequency_hz, rate_hz)
    return np.asarray(torque**2), np.asarray((noise.reading_rad * np.abs(sensitivity)) ** 2)
