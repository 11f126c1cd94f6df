"""The motion: modes exactly by their exponentials, torques of laws by Runge and Kutta's fourth order between them.

Lawson's method (SIAM J. Numer. Anal. 4, 1967): in the variables that the linear plant and the held command carry along,
the classical fourth-order method steps the torques of the laws. Without laws the motion is exact at any step.
"""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.challenge.second.law import Law, no_reading, no_torque
from sim_backend.jit import njit

Array = NDArray[np.float64]

LARGEST_STEP = 0.35
"""Phase of the fastest mode in one step, where a law adds torques; the rest is exact at any step."""


@dataclass(frozen=True)
class Placed:
    """A law in action: its parameters, the size first, at axis `i` (and `j`); `rate` (s⁻¹) is how fast it reacts."""

    law: Law
    p: Array
    i: int
    j: int
    rate: float = 0.0


def exponentials(omega: Array, decay: Array, h: float) -> tuple[Array, Array]:
    """Return the transition (m, 2, 2) of each mode over `h` seconds, and what a unit acceleration held adds (m, 2).

    Taylor's series of a small part of the step, squared up again. Rates are counted in a unit that balances the matrix.
    """
    unit = np.maximum(np.maximum(omega, decay), 1.0 / h if h > 0.0 else 1.0)
    block = np.zeros((omega.size, 3, 3))
    block[:, 0, 1] = unit * h
    block[:, 1, 0], block[:, 1, 1], block[:, 1, 2] = -(omega**2) / unit * h, -2.0 * decay * h, h / unit
    squarings = max(int(np.ceil(np.log2(max(float(np.max(np.abs(block))), 1e-9)))) + 4, 0)
    block /= 2.0**squarings
    whole = term = np.broadcast_to(np.eye(3), block.shape)
    for k in range(1, 13):
        term = term @ block / k
        whole = whole + term
    for _ in range(squarings):
        whole = whole @ whole
    move, add = whole[:, :2, :2].copy(), whole[:, :2, 2].copy()
    move[:, 0, 1] /= unit
    move[:, 1, 0] *= unit
    add[:, 1] *= unit
    return np.ascontiguousarray(move), np.ascontiguousarray(add)


def split_delay(delay_s: float, rate_hz: float) -> tuple[int, float]:
    """Return the whole samples of a delay and the remaining fraction."""
    whole = int(np.floor(delay_s * rate_hz + 1e-9))
    return whole, max(delay_s * rate_hz - whole, 0.0)


@dataclass(frozen=True)
class Motion:
    """What came of a run, each (n, axes): positions, rates, readings before noise, and commands."""

    y: Array
    v: Array
    reading: Array
    command: Array


def integrate(
    plant: Any,
    rate_hz: float,
    external: Array,
    reference: Array,
    noise: Array,
    control: Array | None,
    start: Array,
    laws: list[Placed],
    *,
    extra_delay_s: float = 0.0,
    finer: int = 1,
) -> Motion:
    """Return the motion of a plant from modal states `start` (m, 2), in open loop where `control` is None.

    `control` (axes, 4) has gains and the pole of the rate's filter: command = external + controller(reference −
    reading − noise). `finer` divides the steps. Two torque laws and two reading laws at most.
    """
    whole, part = split_delay(plant.delay_s + extra_delay_s, rate_hz)
    pieces = [part / rate_hz, (1.0 - part) / rate_hz]
    fastest = float(np.max(np.hypot(plant.omega, plant.decay)))
    torques = [x for x in laws if x.law.how == "torque"]
    quickest = max((x.rate for x in torques), default=0.0)
    step = min(LARGEST_STEP / fastest, 0.7 / max(quickest, 1e-12)) / finer if torques else np.inf
    counts = [int(np.ceil(max(h / step, finer))) if h > 0.0 else 0 for h in pieces]
    steps = [h / max(c, 1) for h, c in zip(pieces, counts, strict=True)]
    halves = [exponentials(plant.omega, plant.decay, 0.5 * h) for h in steps]
    readings = [x for x in laws if x.law.how == "reading"]
    force, sense = [_slots(some, none) for some, none in ((torques, no_torque), (readings, no_reading))]
    n, axes = external.shape
    out = np.zeros((4, n, axes))
    gains = np.zeros((axes, 4)) if control is None else control
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "First-class function type", Warning)
        _run(
            out,
            external,
            reference,
            noise,
            gains,
            control is not None,
            np.array(start, dtype=float),
            np.ascontiguousarray(plant.drive),
            np.ascontiguousarray(plant.shape),
            rate_hz,
            whole,
            part,
            np.array(counts),
            np.array(steps),
            np.stack([m for m, _ in halves]),
            np.stack([g for _, g in halves]),
            *force,
            *sense,
        )
    return Motion(out[0], out[1], out[2], out[3])


def _slots(some: list[Placed], none: Any) -> list[tuple[Any, Array, Array, Array, Array, int, int]]:
    """Return what the loop needs of two laws: code, parameters, states (now, tried, rates), axes."""
    slots = [
        (
            x.law.function.made,
            np.asarray(x.p, dtype=float),
            np.zeros(x.law.states),
            np.zeros(x.law.states),
            np.zeros((4, x.law.states)),
            x.i,
            x.j,
        )
        for x in some[:2]
    ]
    return slots + [(none.made, np.zeros(1), np.zeros(0), np.zeros(0), np.zeros((4, 0)), 0, 0)] * (2 - len(slots))


@njit
def _run(
    out, external, reference, noise, gains, closed, q, drive, shape, rate_hz, whole, part, counts, steps, halves,
    answers, first, second, sensor, other,
):  # fmt: skip
    n, axes = external.shape
    work = (np.zeros(axes), np.zeros(axes), np.zeros(axes), np.zeros(axes))
    u, y, v = work[0], work[1], work[2]
    r, total, slope, last, rows = np.zeros(axes), np.zeros(axes), np.zeros(axes), np.zeros(axes), np.zeros((2, axes))
    modal = (np.zeros((4, q.shape[0])), np.zeros(q.shape), np.zeros(q.shape))
    for k in range(n):
        _place(q, shape, y, v)
        t = k / rate_hz
        _copy(y, r)
        sensor[0](t, y, v, u, sensor[2], sensor[1], r, sensor[5], sensor[6])
        other[0](t, y, v, u, other[2], other[1], r, other[5], other[6])
        for a in range(axes):
            out[0, k, a], out[1, k, a], out[2, k, a] = y[a], v[a], r[a]
            command = external[k, a]
            if closed:
                error = reference[k, a] - r[a] - noise[k, a]
                rate = (error - last[a]) * rate_hz if k > 0 else 0.0
                slope[a] = gains[a, 3] * slope[a] + (1.0 - gains[a, 3]) * rate
                total[a] += error / rate_hz
                last[a] = error
                command += gains[a, 0] * error + gains[a, 1] * total[a] + gains[a, 2] * slope[a]
            out[3, k, a] = command
            rows[0, a] = out[3, k - whole - 1, a] if k > whole else 0.0
            rows[1, a] = out[3, k - whole, a] if k >= whole else 0.0
        at = t
        for piece in range(2):
            if counts[piece] > 0:
                _copy(rows[piece], u)
            for _ in range(counts[piece]):
                _step(q, modal, work, at, steps[piece], halves[piece], answers[piece], drive, shape, first, second)
                at += steps[piece]


@njit
def _step(q, modal, work, at, h, e, g, drive, shape, first, second):
    """Step modes and states of laws by `h`. Stages begin at 0, 1/2, 1/2 and 1 of it."""
    push, trial, middle = modal
    u, y, v, f = work
    for m in range(q.shape[0]):
        trial[m, 0], trial[m, 1] = q[m, 0], q[m, 1]
    for stage in range(4):
        part = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        if stage == 1:
            _carry(q, push[0], 0.5 * h, drive, u, e, g, trial)
            for m in range(q.shape[0]):
                middle[m, 0] = trial[m, 0] - 0.5 * h * e[m, 0, 1] * push[0, m]
                middle[m, 1] = trial[m, 1] - 0.5 * h * e[m, 1, 1] * push[0, m]
        elif stage == 2:
            for m in range(q.shape[0]):
                trial[m, 0], trial[m, 1] = middle[m, 0], middle[m, 1] + 0.5 * h * push[1, m]
        elif stage == 3:
            _carry(middle, push[2], h, drive, u, e, g, trial)
        _place(trial, shape, y, v)
        f[:] = 0.0
        _torque(first, at + h * part, y, v, u, f, stage, h * part)
        _torque(second, at + h * part, y, v, u, f, stage, h * part)
        for m in range(q.shape[0]):
            push[stage, m] = 0.0
            for a in range(u.size):
                push[stage, m] += drive[m, a] * f[a]
    _finish(q, middle, push, h, drive, u, e, g)
    for slot in (first, second):
        states, rates = slot[2], slot[4]
        for c in range(states.size):
            states[c] += h / 6.0 * (rates[0, c] + 2.0 * rates[1, c] + 2.0 * rates[2, c] + rates[3, c])


@njit
def _torque(slot, t, y, v, u, f, stage, ahead):
    """Add the torque of a law to f, its states being `ahead` by the rates of the stage before."""
    states, trial, rates = slot[2], slot[3], slot[4]
    for c in range(states.size):
        trial[c] = states[c] + (ahead * rates[stage - 1, c] if stage > 0 else 0.0)
    slot[0](t, y, v, u, trial, rates[stage], slot[1], f, slot[5], slot[6])


@njit
def _copy(values, into):
    for a in range(into.size):
        into[a] = values[a]


@njit
def _place(q, shape, y, v):
    for a in range(y.size):
        y[a] = 0.0
        v[a] = 0.0
        for m in range(q.shape[0]):
            y[a] += shape[a, m] * q[m, 0]
            v[a] += shape[a, m] * q[m, 1]


@njit
def _carry(middle, push, h, drive, u, e, g, trial):
    """Carry the middle over the second half step, with a whole step of the third torque: E·(middle + h k3) + g·B u."""
    for m in range(middle.shape[0]):
        b = 0.0
        for a in range(u.size):
            b += drive[m, a] * u[a]
        q0, q1 = middle[m, 0], middle[m, 1] + h * push[m]
        trial[m, 0] = e[m, 0, 0] * q0 + e[m, 0, 1] * q1 + g[m, 0] * b
        trial[m, 1] = e[m, 1, 0] * q0 + e[m, 1, 1] * q1 + g[m, 1] * b


@njit
def _finish(q, middle, push, h, drive, u, e, g):
    """Add up a step: E·(middle + E·h/6 k1 + h/3 (k2 + k3)) + g·B u + h/6 k4."""
    for m in range(q.shape[0]):
        b = 0.0
        for a in range(u.size):
            b += drive[m, a] * u[a]
        q0 = middle[m, 0] + h / 6.0 * e[m, 0, 1] * push[0, m]
        q1 = middle[m, 1] + h / 6.0 * e[m, 1, 1] * push[0, m] + h / 3.0 * (push[1, m] + push[2, m])
        q[m, 0] = e[m, 0, 0] * q0 + e[m, 0, 1] * q1 + g[m, 0] * b
        q[m, 1] = e[m, 1, 0] * q0 + e[m, 1, 1] * q1 + g[m, 1] * b + h / 6.0 * push[3, m]
