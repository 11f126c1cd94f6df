"""Repetitive control at design level: learning filter L, lead, gain, Q filter and convergence.

    u_{k} = Q (u_{k-N} + k_r z^gamma L e_{k-N}),   converges monotonically where |Q (1 - z^gamma S_p k_r L)| <
    1

with S_p = P/(1 + P C), or P alone while the feedback is open. L is the inverse of the plant's modes, made
proper by a Butterworth low pass whose delay the lead gamma takes back. It is designed in continuous time,
because sampling puts zeros of the plant outside the unit circle, and then mapped by Tustin. Source: section
6.3.2 and Table 6.5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim_backend.control.blocks import DiscreteFilter, filter_from_zpk, tustin_zpk
from sim_backend.errors import ConfigError

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True)
class LearningTuning:
    """One row of Table 6.5: gain k_r, lead gamma in samples and the low pass's cut-off frequency."""

    gain: float
    lead_samples: int
    cutoff_hz: float


TABLE_6_5 = {"theta_x": LearningTuning(0.1, 8, 500.0), "theta_y": LearningTuning(0.5, 9, 500.0)}
"""What the paper tuned, at 10 kHz."""


def learning_filter(
    omega_rad_s: ArrayLike,
    sigma_1_s: ArrayLike,
    static_gain: float,
    cutoff_hz: float,
    rate_hz: float,
    order: int = 4,
) -> DiscreteFilter:
    """Return L, the inverse of the given modes behind a Butterworth low pass.

    Before the low pass it is Π (s² + 2 sigma s + omega²)/omega² over the modes (m,), divided by
    `static_gain`. `static_gain` is the plant's, in output per input unit, so L is in input per output unit.
    Raises ConfigError when the low pass is of lower order than the modes, its cut-off lies beyond half the
    rate or a mode or the gain is zero.
    """
    omega = np.atleast_1d(np.asarray(omega_rad_s, dtype=float))
    sigma = np.atleast_1d(np.asarray(sigma_1_s, dtype=float))
    if not 0.0 < cutoff_hz < 0.5 * rate_hz:
        raise ConfigError(f"learning filter: cut-off {cutoff_hz} Hz at {rate_hz} Hz; keep it below half the rate")
    if 2 * omega.size > order:
        raise ConfigError(
            f"learning filter: {omega.size} modes need a low pass of order {2 * omega.size}, it has {order}"
        )
    if np.any(omega <= 0.0) or static_gain == 0.0:
        raise ConfigError("learning filter: a mode's frequency or the static gain is zero; a plant at rest must answer")
    root = np.sqrt((sigma**2 - omega**2).astype(complex))
    zeros = np.concatenate([-sigma + root, -sigma - root])
    cutoff = 2.0 * np.pi * cutoff_hz
    poles = cutoff * np.exp(1j * np.pi * (0.5 + (np.arange(order) + 0.5) / order))
    # of the highest powers of s: the modes are monic over Π omega², the low pass is cutoff^order over monic
    gain = cutoff**order / np.prod(omega**2) / static_gain
    return filter_from_zpk(*tustin_zpk(zeros, poles, float(gain), rate_hz), rate_hz)


def process_sensitivity(plant: ArrayLike, controller: ArrayLike) -> ComplexArray:
    """Return S_p = P/(1 + P C) from the responses of plant and controller on one grid, any shape."""
    p, c = np.asarray(plant), np.asarray(controller)
    return np.asarray(p / (1.0 + p * c), dtype=complex)


def q_taps(cutoff_hz: float, half_length: int, rate_hz: float) -> tuple[float, ...]:
    """Return a symmetric low pass of 2 `half_length` + 1 taps and unit gain at 0 Hz: a sinc under a Hann window.

    Zero phase, because the last period is known ahead. Raises ConfigError when the cut-off lies beyond half
    the rate.
    """
    if not (0.0 < cutoff_hz < 0.5 * rate_hz and half_length >= 0):
        raise ConfigError(
            f"Q filter: cut-off {cutoff_hz} Hz at {rate_hz} Hz with {half_length} taps aside; "
            "keep the cut-off between 0 and half the rate"
        )
    k = np.arange(-half_length, half_length + 1)
    taps = np.sinc(2.0 * cutoff_hz / rate_hz * k) * np.cos(0.5 * np.pi * k / (half_length + 1)) ** 2
    return tuple(float(t) for t in taps / taps.sum())


def q_response(taps: ArrayLike, frequency_hz: ArrayLike, rate_hz: float) -> Array:
    """Return the real response, shape (n_f,), of symmetric taps (odd length)."""
    h = np.asarray(taps, dtype=float)
    half = h.size // 2
    angle = 2.0 * np.pi * np.asarray(frequency_hz, dtype=float)[:, None] / rate_hz * np.arange(1, half + 1)
    return np.asarray(h[half] + 2.0 * np.cos(angle) @ h[half + 1 :], dtype=float)


def convergence(
    frequency_hz: ArrayLike,
    process: ArrayLike,
    learning: DiscreteFilter,
    gain: float,
    lead_samples: int,
    taps: ArrayLike = (1.0,),
) -> Array:
    """Return |Q (1 - z^gamma S_p k_r L)|, shape (n_f,): by how much an error shrinks from one period to the next.

    `process` (n_f,) is the sampled response from the learned input to the output. Below one everywhere,
    learning converges monotonically; above one it amplifies there.
    """
    f = np.asarray(frequency_hz, dtype=float)
    lead = np.exp(2j * np.pi * f / learning.rate_hz * lead_samples)
    step = 1.0 - lead * np.asarray(process) * gain * learning.frequency_response(f)
    return np.asarray(np.abs(q_response(taps, f, learning.rate_hz) * step), dtype=float)
