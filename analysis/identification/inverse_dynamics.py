"""A linear axis beside friction: the balance of torques, term by term, where a linear fit alone would be biased.

An axis that drifts (with little or no suspension) and has friction has no linear model that simulates it: a fit then
makes an oscillator of the friction. The balance of torques u = M a + D v + K y + F sign(v) + u0 is linear in all its
numbers, and whatever the loop around the axis does, the measured motion is on one side only. All signals pass the same
smoothing filter, so that the equation holds for the filtered signals.

Source: the inverse dynamic identification of robots, M. Gautier, J. Robotic Systems 14 (1997).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.identification.determined import SIGNIFICANT
from sim_backend.linear import ModalModel

Array = NDArray[np.float64]

WINDOWS = (7, 11, 17, 27, 43, 67, 107)
"""Samples over which the signals are smoothed; the best balance decides."""

_FEWEST = 7
"""Samples through which a cubic is laid at least."""

_ROWS = 20
"""Samples of motion for each of a window's samples: five numbers are fitted, and what a window smooths is one."""

SHARE = 0.5
"""Friction, or a constant torque, counts when it takes this part of what the other terms leave of the torque, in
squares."""

_SLIPS = 2.0
"""Times the rate of standstill at which a friction that turns smoothly is taken to be whole."""

_TERMS = 5
"""Numbers of the axis's own: inertia, drag, spring, friction and what is always there."""

BALANCED = 0.9
"""All terms together have to explain this part of the torque, in squares."""


@dataclass(frozen=True)
class Balance:
    """The balance of one axis: its linear model, its standard deviations in the same shapes, the friction beside it.

    `friction`, zero where there is none, and `constant`, the torque that is always there (its standard deviation
    `constant_std`), are in units of the axis's own drive. `free` tells whether nothing holds the axis, `pushed` whether
    the constant torque bends a linear fit, as it does there. All terms explain the part `explained` of the torque,
    the motion being smoothed over `window` samples.
    """

    linear: ModalModel
    std: ModalModel
    friction: float
    constant: float
    constant_std: float
    free: bool
    pushed: bool
    explained: float
    window: int

    def starts(self, y: Array, rate_hz: float) -> tuple[float, float]:
        """Return position and rate at the first sample of readings `y` (n,), of the cubic through the first few."""
        first = y[: max(self.window // 4, _FEWEST)]  # a kernel counts in the middle half of its window
        taps = [
            scipy.signal.savgol_coeffs(first.size, 3, deriv=d, delta=1.0 / rate_hz, pos=0, use="dot") for d in range(2)
        ]
        return float(taps[0] @ first), float(taps[1] @ first)


def balance_of(inputs: Sequence[Array], outputs: Sequence[Array], rate_hz: float) -> Balance | None:
    """Return the balance of torques of one axis that rubs or that nothing holds; None for others.

    Shapes: every record's inputs (n, n_u), the axis's own drive first and those of other axes after it, and its reading
    (n, 1). Of the other drives what is significant acts on the axis too. Friction bends a linear fit, and so does a
    constant torque on what nothing holds: beside a spring that is an offset of the reading.
    """
    if outputs[0].shape[1] != 1:
        return None
    longest = max(y.shape[0] for y in outputs)
    windows = [window for window in WINDOWS if _ROWS * window < longest]
    own = [u[:, :1] for u in inputs]
    tried = [(fitted, window) for window in windows if (fitted := _fitted(own, outputs, rate_hz, window)) is not None]
    best, window = max(tried, key=lambda one: one[0].explained, default=(None, 0))
    if best is None or best.explained < BALANCED:
        return None
    coupling, coupling_std = np.zeros(inputs[0].shape[1] - 1), np.zeros(inputs[0].shape[1] - 1)
    if coupling.size and (beside := _fitted(inputs, outputs, rate_hz, window)) is not None:
        known = np.abs(beside.numbers[_TERMS:]) > SIGNIFICANT * beside.deviations[_TERMS:]
        if np.any(known):
            some = [u[:, np.r_[True, known]] for u in inputs]
            best = _fitted(some, outputs, rate_hz, window) or best
            coupling[known], coupling_std[known] = -best.numbers[_TERMS:], best.deviations[_TERMS:]
    mass, damping, spring, friction = best.numbers[:4]
    # nothing, or less, holds the axis: a period of ten records stands for none
    slowest = 2.0 * np.pi * rate_hz / (10.0 * longest)
    rubs = best.by_friction >= SHARE and friction > 0.0 and damping > 0.0
    # a spring that takes longer than the record to swing back holds nothing in it
    free = spring < mass * (10.0 * slowest) ** 2
    if not (mass > 0.0 and (rubs or free)):
        return None
    omega = float(np.sqrt(max(spring / mass, slowest**2)))
    sigma = float(max(0.5 * damping / mass, slowest))
    relative = best.deviations[:3] / np.abs(best.numbers[:3])
    linear = _axis(omega, sigma, np.append(1.0, coupling) / mass)
    spread = float(0.5 * omega * min(relative[2] + relative[0], 1.0))
    std = _axis(spread, sigma * (relative[0] + relative[1]), np.append(relative[0], coupling_std) / mass)
    return Balance(
        linear,
        std.with_(c=np.zeros((1, 1))),
        float(friction) if rubs else 0.0,
        -float(best.numbers[4]),
        float(best.deviations[4]),
        free,
        free and best.by_constant >= SHARE,
        best.explained,
        window,
    )


@dataclass(frozen=True)
class _Fitted:
    """M, D, K, F, offset and what other drives subtract, with deviations, and the part of the torque they explain.

    `by_friction` and `by_constant` are the parts that friction and offset explain of the residual without them.
    """

    numbers: Array
    deviations: Array
    explained: float
    by_friction: float
    by_constant: float


def _fitted(inputs: Sequence[Array], outputs: Sequence[Array], rate_hz: float, window: int) -> _Fitted | None:
    """Return the balance over the samples in which the axis moves; None where these are few.

    Where there are enough samples with motion in one direction over a whole window, friction is constant there and its
    behaviour at a reversal need not be known.
    """
    records = [(u, y[:, 0]) for u, y in zip(inputs, outputs, strict=True) if y.size > 2 * window + 2]
    parts = [_terms(u, y, rate_hz, window) for u, y in records]
    chosen = [part.throughout for part in parts]
    if sum(int(rows.sum()) for rows in chosen) < _ROWS * window:
        chosen = [part.moving for part in parts]
    if sum(int(rows.sum()) for rows in chosen) < _ROWS * window:
        return None
    x = np.concatenate([part.terms[rows] for part, rows in zip(parts, chosen, strict=True)])
    torque = np.concatenate([part.torque[rows] for part, rows in zip(parts, chosen, strict=True)])
    with_all, numbers, deviations = _least_squares(x, torque, window)
    without = [_least_squares(np.delete(x, k, axis=1), torque, window)[0] for k in (3, 4)]
    total = float(np.sum((torque - torque.mean()) ** 2))
    shares = (1.0 - with_all / max(rest, 1e-300) for rest in (total, *without))
    return _Fitted(numbers, deviations, *shares)


@dataclass(frozen=True)
class _Part:
    """What one record adds: the smoothed `torque` (n,), its `terms` (n, k), and the samples that may be used.

    In those `moving` the axis moves, and around those `throughout` it does so for a whole window.
    """

    torque: Array
    terms: Array
    moving: NDArray[np.bool_]
    throughout: NDArray[np.bool_]


def _terms(u: Array, y: Array, rate_hz: float, window: int) -> _Part:
    """Return the terms of one record, `u` (n, n_u) and `y` (n,), all smoothed by one kernel.

    Under a held torque the second difference of an inertia's position is exactly the mean of two neighbouring torques,
    so nothing is lost by differences of neighbours. What they make of the noise a kernel takes away that fades smoothly
    to zero at its ends. Derivatives of a polynomial laid through the window would have each a smoothing of its own, and
    the numbers come out wrong by per cents.
    Source: the modulating functions of M. Shinbrot, Trans. ASME 79 (1957).
    """
    kernel = scipy.signal.windows.hann(window + 2)[1:-1] ** 2
    kernel /= kernel.sum()
    half = window // 2

    def smooth(series: Array) -> Array:
        return np.convolve(series, kernel, mode="valid")

    inner, held = y[half:-half], u[half:-half]  # samples at which a smoothed rate is known, and one more at either end
    rate = _slope(smooth(y), rate_hz)
    acceleration = np.diff(inner, 2) * rate_hz**2
    # a hold gives each torque from its sample on
    torque, *other = (smooth(column) for column in (0.5 * (held[1:-1] + held[:-2])).T)
    own = (acceleration, _slope(inner, rate_hz), inner[1:-1], np.sign(rate))
    terms = [*(smooth(series) for series in own), np.ones_like(torque), *other]
    # at rest friction equals the applied torque, and no balance distinguishes it from the drive
    slow = np.abs(rate) <= _SLIPS * _still(rate)
    throughout = np.convolve(slow, np.ones(window), mode="valid") < 0.5
    return _Part(torque, np.stack(terms, axis=1), np.abs(smooth(rate)) > _still(rate), throughout)


def _slope(series: Array, rate_hz: float) -> Array:
    """Return the slope of a series (n,) at all its samples but the first and the last, (n - 2,)."""
    return (series[2:] - series[:-2]) * 0.5 * rate_hz


def _still(rate: Array) -> float:
    """Return the rate below which an axis counts as standing: a hundredth of its fastest."""
    return max(1e-2 * float(np.max(np.abs(rate))), 1e-300)


def _least_squares(x: Array, y: Array, window: int) -> tuple[float, Array, Array]:
    """Return the residual sum of squares, the numbers and their deviations; `window` samples count as one."""
    scale = np.maximum(np.linalg.norm(x, axis=0), 1e-300)
    numbers, _, _, _ = np.linalg.lstsq(x / scale, y, rcond=1e-12)
    left = float(np.sum((y - x / scale @ numbers) ** 2))
    inverse = np.linalg.pinv((x / scale).T @ (x / scale))
    variance = left / max(y.size / window - x.shape[1], 1.0) * np.diag(inverse)
    return left, numbers / scale, np.sqrt(np.maximum(variance, 0.0)) / scale


def _axis(omega_rad_s: float, sigma_1_s: float, gains: Array) -> ModalModel:
    none = np.zeros((1, gains.size))
    return ModalModel(
        omega_rad_s=np.array([omega_rad_s]),
        sigma_1_s=np.array([sigma_1_s]),
        b=gains[None, :],
        b_direct=none,
        c=np.ones((1, 1)),
        c_rate=np.zeros((1, 1)),
        d=none,
        delay_s=np.zeros(gains.size),
    )
