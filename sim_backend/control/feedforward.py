"""Model-based feed-forward: the input samples that carry a plant from rest to rest in a given number of samples.

Among all inputs that do so, the one of least norm (the idea of (3.11)); with the amplifiers' limit as a bound
on every sample; or, when only the output has to be there in time, the one of least peak, found by a linear
programme in which the input may go on acting inside the tolerance. All work in deviations from the level the
move starts at, on the plant behind its zero-order hold, for any number of inputs and outputs. A delay of an
input only moves its samples; it is left out here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from sim_backend.errors import ConfigError
from sim_backend.linear import DiscreteModel, ModalModel, discretise, nonzero

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StepInput:
    """An input for one move from rest: `drive` (n, n_u) sample by sample, then `holding` (n_u,) for ever.

    `step` (n_y,) is the move in output units; `arrival` the sample from which on the output has arrived (n,
    unless the input goes on acting after it). All at `rate_hz`, in deviations from the level before.
    """

    drive: Array
    holding: Array
    step: Array
    arrival: int
    rate_hz: float

    @property
    def peak(self) -> float:
        """Largest magnitude over all inputs and samples, the holding level included."""
        return float(max(np.max(np.abs(self.drive), initial=0.0), np.max(np.abs(self.holding))))

    def scaled(self, factor: float) -> StepInput:
        """Return the input for `factor` times the move: the plant is linear."""
        return StepInput(self.drive * factor, self.holding * factor, self.step * factor, self.arrival, self.rate_hz)


def _matrices(plant: DiscreteModel) -> tuple[Array, Array, Array]:
    m, n_u, n_y = plant.a.shape[0], plant.b.shape[2], plant.c.shape[0]
    a = np.zeros((2 * m, 2 * m))
    for i in range(m):
        a[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = plant.a[i]
    return a, plant.b.reshape(2 * m, n_u), plant.c.reshape(n_y, 2 * m)


def rest_state(plant: DiscreteModel, output: ArrayLike) -> tuple[Array, Array]:
    """Return the state (2m,) at rest with the given output (n_y,) and the holding input (n_u,) that keeps it there.

    x = A x + B u, y = C x + D u, solved with the least input, so that a rigid body is held by nothing. Raises
    ConfigError when no input can hold that output.
    """
    a, b, c = _matrices(plant)
    y = np.atleast_1d(np.asarray(output, dtype=float))
    n, n_u = b.shape
    system = np.block([[np.eye(n) - a, -b], [c, plant.d]])
    wanted = np.concatenate([np.zeros(n), y])
    row = nonzero(np.linalg.norm(system, axis=1))
    column = nonzero(np.linalg.norm(system / row[:, None], axis=0))
    solution = np.linalg.lstsq(system / row[:, None] / column, wanted / row, rcond=None)[0] / column
    reached = c @ solution[:n] + plant.d @ solution[n:]
    if np.max(np.abs(reached - y)) > 1e-6 * max(np.max(np.abs(y)), np.finfo(float).tiny):
        raise ConfigError(
            f"output {y.tolist()} cannot be held at rest: the plant comes to {reached.tolist()}; add an input"
        )
    return solution[:n], solution[n:]


def reach_matrix(plant: DiscreteModel, n_samples: int) -> Array:
    """Return W (2m, n n_u): the state after `n_samples` from rest is W times the inputs, first sample first."""
    a, b, _ = _matrices(plant)
    n, n_u = b.shape
    w = np.empty((n, n_samples, n_u))
    power = b
    for k in range(n_samples - 1, -1, -1):
        w[:, k] = power
        power = a @ power
    return w.reshape(n, n_samples * n_u)


def least_norm(
    model: ModalModel, step: ArrayLike, n_samples: int, rate_hz: float, peak: float | None = None
) -> StepInput:
    """Return the input of least norm that moves `model` by `step` (n_y,), from rest to rest, in `n_samples`.

    With `peak`, no sample exceeds it in magnitude. Raises ConfigError when the samples are too few to bring
    every mode to rest, or the peak is too low. Source: (3.11).
    """
    plant = discretise(model, rate_hz)
    target, holding = rest_state(plant, step)
    w = reach_matrix(plant, n_samples)
    _require_samples(w, n_samples)
    # rows made orthonormal: q' u = wanted, which no scaling of the states can spoil
    scale = 1.0 / nonzero(np.linalg.norm(w, axis=1))
    q, r = np.linalg.qr((w * scale[:, None]).T)
    wanted = np.linalg.solve(r.T, target * scale)
    u = q @ wanted if peak is None else _bounded(q, wanted, peak)
    move = np.atleast_1d(np.asarray(step, dtype=float))
    return StepInput(u.reshape(n_samples, -1), holding, move, n_samples, rate_hz)


def _require_samples(w: Array, n_samples: int) -> None:
    if w.shape[0] > w.shape[1]:
        raise ConfigError(
            f"feed-forward: {n_samples} samples give {w.shape[1]} numbers to bring {w.shape[0]} states to rest; "
            f"allow {-(-w.shape[0] * n_samples // w.shape[1])} samples or more"
        )


def _bounded(q: Array, wanted: Array, peak: float) -> Array:
    """Least-norm u with q' u = wanted and |u| <= peak, by Newton's method on the dual, where u = clip(q l)."""
    needed = _least_peak(q, wanted)
    if needed > peak:
        raise ConfigError(
            f"feed-forward needs a peak of {needed:.4g}, the limit is {peak:.4g}; allow more samples or a smaller step"
        )
    multiplier = wanted.copy()

    def value(at: Array) -> float:
        z = q @ at
        inside = np.clip(z, -peak, peak)
        return float(np.sum(inside * z - 0.5 * inside**2) - wanted @ at)

    for _ in range(200):
        z = q @ multiplier
        gradient = q.T @ np.clip(z, -peak, peak) - wanted
        if np.linalg.norm(gradient) <= 1e-13 * np.linalg.norm(wanted):
            break
        free = q[np.abs(z) < peak]
        # the ridge matters only where too few samples are free to span all states
        curvature = free.T @ free + 1e-12 * np.eye(wanted.size)
        direction = -np.linalg.solve(curvature, gradient)
        size, start = 1.0, value(multiplier)
        while value(multiplier + size * direction) > start + 1e-4 * size * float(gradient @ direction) and size > 1e-12:
            size *= 0.5
        multiplier = multiplier + size * direction
    return np.clip(q @ multiplier, -peak, peak)


def _least_peak(q: Array, wanted: Array) -> float:
    """Least possible peak of any u with q' u = wanted, by a linear programme in (u, peak)."""
    n = q.shape[0]
    column = np.ones((n, 1))
    rows = np.block([[np.eye(n), -column], [-np.eye(n), -column]])
    equal = np.hstack([q.T, np.zeros((wanted.size, 1))])
    cost = np.concatenate([np.zeros(n), [1.0]])
    size = np.linalg.norm(wanted) or 1.0
    found = scipy.optimize.linprog(
        cost, rows, np.zeros(2 * n), equal, wanted / size, bounds=[(None, None)] * n + [(0.0, None)]
    )
    return float(found.fun * size)


def least_peak_within(
    model: ModalModel,
    step: ArrayLike,
    n_samples: int,
    tolerance: float,
    n_acting: int,
    rate_hz: float,
    rest: bool = True,
) -> StepInput:
    """Return the input of least peak that keeps every output within `tolerance` of `step` from sample `n_samples` on.

    `step` is (n_y,) in output units. The input acts for `n_acting` samples. With `rest` every mode is then exactly at
    rest; without, modes may still move against each other behind a quiet output, which a lightly damped zero of the
    plant carries on for as long as it rings: the input must then act until the next move. Raises ConfigError when the
    samples are too few or the tolerance not positive.
    """
    if not (n_acting >= n_samples > 0 and tolerance > 0.0):
        raise ConfigError(
            f"feed-forward: arrival after {n_samples} of {n_acting} samples within {tolerance}; "
            "needs 0 < arrival <= acting and a tolerance above zero"
        )
    plant = discretise(model, rate_hz)
    target, holding = rest_state(plant, step)
    move = np.atleast_1d(np.asarray(step, dtype=float))
    w = reach_matrix(plant, n_acting)
    if rest:
        _require_samples(w, n_acting)
    # in units of the tolerance, so that the solver's own tolerance of 1e-7 means 1e-7 of it
    output = _late_outputs(plant, w, n_samples) / tolerance
    centre = np.tile(move / tolerance, n_acting - n_samples)
    n = w.shape[1]
    no_peak, peak = np.zeros((output.shape[0], 1)), np.ones((n, 1))
    rows = np.block([[output, no_peak], [-output, no_peak], [np.eye(n), -peak], [-np.eye(n), -peak]])
    scale = 1.0 / nonzero(np.linalg.norm(w, axis=1))
    found = scipy.optimize.linprog(
        np.concatenate([np.zeros(n), [1.0]]),
        rows,
        np.concatenate([centre + 1.0, 1.0 - centre, np.zeros(2 * n)]),
        np.hstack([w * scale[:, None], np.zeros((w.shape[0], 1))]) if rest else None,
        target * scale if rest else None,
        bounds=[(None, None)] * n + [(float(np.max(np.abs(holding))), None)],
    )
    if found.x is None:
        raise ConfigError(
            f"feed-forward: no input keeps the output within {tolerance} after {n_samples} samples; allow more"
        )
    return StepInput(found.x[:n].reshape(n_acting, -1), holding, move, n_samples, rate_hz)


def _late_outputs(plant: DiscreteModel, w: Array, first: int) -> Array:
    """Outputs at samples first … n - 1 as rows over all inputs, from the reach matrix `w` of n samples."""
    n_y, n_u = plant.d.shape
    n = w.shape[1] // n_u
    # C W holds the Markov parameters C A^j B, j falling with time: the response after k samples is its last k blocks
    markov = (_matrices(plant)[2] @ w).reshape(n_y, n, n_u)
    response = np.zeros((n - first, n_y, n, n_u))
    for row, k in enumerate(range(first, n)):
        response[row, :, :k] = markov[:, n - k :]
        response[row, :, k] = plant.d
    return response.reshape((n - first) * n_y, n * n_u)


def step_response(plant: DiscreteModel, move: StepInput, n_samples: int) -> Array:
    """Return the output (n_samples, n_y) of `plant` from rest under `move`, its holding level played on to the end."""
    a, b, c = _matrices(plant)
    u = np.concatenate([move.drive, np.tile(move.holding, (max(n_samples - move.drive.shape[0], 0), 1))])[:n_samples]
    response = np.empty((n_samples, *plant.d.shape))
    response[0], power = plant.d, b
    for k in range(1, n_samples):
        response[k] = c @ power
        power = a @ power
    out = np.zeros((n_samples, plant.d.shape[0]))
    for i in range(out.shape[1]):
        for j in range(u.shape[1]):
            out[:, i] += np.convolve(response[:, i, j], u[:, j])[:n_samples]
    return out
