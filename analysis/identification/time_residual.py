"""Output error of a ModalModel on time records: normal equations over parameters, initial states and offsets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.identification.block_basis import block_matrices
from analysis.identification.modal_parameters import Layout, participation, unpack
from analysis.identification.normal_equations import Normal
from analysis.linear.simulate import delayed, simulate_linear, weighted
from sim_backend.jit import njit
from sim_backend.linear import Array, ModalModel, delay_taps, discretise

# samples per pass: the Jacobian of one output over this many samples stays small enough for the cache
_CHUNK = 4096


@dataclass(frozen=True)
class TimeTarget:
    """Records `inputs` (n, n_u) and `outputs` (n, n_y) at one rate, and how their error is whitened.

    `whitening` (n_y, p + 1) is the filter of each output's error, 1 ÷ noise standard deviation already in it; the first
    p samples of a record only feed the filter.
    """

    inputs: tuple[Array, ...]
    outputs: tuple[Array, ...]
    rate_hz: float
    whitening: Array

    @property
    def values(self) -> int:
        """Number of output values that enter the sum of squares."""
        skip = self.whitening.shape[1] - 1
        return sum((y.shape[0] - skip) * y.shape[1] for y in self.outputs)


@dataclass(frozen=True)
class Nuisance:
    """Where a record's initial states (m, 2) and offsets (n_y,) stand behind the model's parameters."""

    state: NDArray[np.intp]
    offset: NDArray[np.intp]


def nuisances(layout: Layout, records: int) -> list[Nuisance]:
    """Return the place of each record's nuisance parameters."""
    m, n_y = layout.n_blocks, layout.n_outputs
    size = 2 * m + n_y
    starts = layout.size + size * np.arange(records)
    return [Nuisance(np.arange(s, s + 2 * m).reshape(m, 2), np.arange(s + 2 * m, s + size)) for s in starts]


@njit
def _block_signals(a: Array, b: Array, da: Array, db: Array, u: Array, state: Array, out: Array) -> None:
    """Step every block for every input with both sensitivities, `state` and `out` (m, n_u + 2, 6, …).

    The six are q, v and their derivatives to ln(omega) and ln(sigma). The last two inputs are zero: they carry the free
    responses to a unit initial position and rate.
    """
    m, n_in, n = a.shape[0], state.shape[1], u.shape[1]
    for i in range(m):
        for j in range(n_in):
            q, v = state[i, j, 0], state[i, j, 1]
            qo, vo, qs, vs = state[i, j, 2], state[i, j, 3], state[i, j, 4], state[i, j, 5]
            driven = j < u.shape[0]
            for k in range(n):
                drive = u[j, k] if driven else 0.0
                out[i, j, 0, k], out[i, j, 1, k] = q, v
                out[i, j, 2, k], out[i, j, 3, k] = qo, vo
                out[i, j, 4, k], out[i, j, 5, k] = qs, vs
                nqo = a[i, 0, 0] * qo + a[i, 0, 1] * vo + da[0, i, 0, 0] * q + da[0, i, 0, 1] * v + db[0, i, 0] * drive
                nvo = a[i, 1, 0] * qo + a[i, 1, 1] * vo + da[0, i, 1, 0] * q + da[0, i, 1, 1] * v + db[0, i, 1] * drive
                nqs = a[i, 0, 0] * qs + a[i, 0, 1] * vs + da[1, i, 0, 0] * q + da[1, i, 0, 1] * v + db[1, i, 0] * drive
                nvs = a[i, 1, 0] * qs + a[i, 1, 1] * vs + da[1, i, 1, 0] * q + da[1, i, 1, 1] * v + db[1, i, 1] * drive
                nq = a[i, 0, 0] * q + a[i, 0, 1] * v + b[i, 0] * drive
                nv = a[i, 1, 0] * q + a[i, 1, 1] * v + b[i, 1] * drive
                q, v, qo, vo, qs, vs = nq, nv, nqo, nvo, nqs, nvs
            state[i, j, 0], state[i, j, 1] = q, v
            state[i, j, 2], state[i, j, 3], state[i, j, 4], state[i, j, 5] = qo, vo, qs, vs


def model_outputs(target: TimeTarget, vector: Array, layout: Layout) -> list[Array]:
    """Return the model's output (n, n_y) for every record, initial states and offsets included."""
    discrete = discretise(unpack(vector, layout), target.rate_hz)
    places = nuisances(layout, len(target.inputs))
    return [
        simulate_linear(discrete, u, vector[place.state]) + vector[place.offset]
        for u, place in zip(target.inputs, places, strict=True)
    ]


def whitened_cost(target: TimeTarget, vector: Array, layout: Layout) -> float:
    """Return the sum of squares of the whitened error."""
    skip, cost = target.whitening.shape[1] - 1, 0.0
    for measured, modelled in zip(target.outputs, model_outputs(target, vector, layout), strict=True):
        for o in range(measured.shape[1]):
            error = scipy.signal.lfilter(target.whitening[o], [1.0], modelled[:, o] - measured[:, o])[skip:]
            cost += float(error @ error)
    return cost


def time_normal_equations(target: TimeTarget, vector: Array, layout: Layout) -> Normal:
    """Return cost, J'r and J'J over the model's parameters and all nuisance parameters, record by record."""
    places = nuisances(layout, len(target.inputs))
    modelled = model_outputs(target, vector, layout)
    gradient, hessian, cost = np.zeros(vector.size), np.zeros((vector.size, vector.size)), 0.0
    skip = target.whitening.shape[1] - 1
    for r, place in enumerate(places):
        error = modelled[r] - target.outputs[r]
        tails: list[Array | None] = [None] * layout.n_outputs
        for start, columns in _jacobians(target, r, vector, layout, place):
            for o, (index, jacobian) in enumerate(columns):
                stop = start + jacobian.shape[1]
                rows = np.concatenate([jacobian, error[None, start:stop, o]])
                history = tails[o]
                joined = rows if history is None else np.concatenate([history, rows], axis=1)
                tails[o] = joined[:, joined.shape[1] - skip :] if skip else None
                white = scipy.signal.lfilter(target.whitening[o], [1.0], joined, axis=1)[:, skip:]
                cost += float(white[-1] @ white[-1])
                gradient[index] += white[:-1] @ white[-1]
                hessian[np.ix_(index, index)] += white[:-1] @ white[:-1].T
    return Normal(cost, gradient, hessian)


def _jacobians(
    target: TimeTarget, record: int, vector: Array, layout: Layout, place: Nuisance
) -> Iterator[tuple[int, list[tuple[NDArray[np.intp], Array]]]]:
    """Yield per chunk its first sample and, per output, the indices (k,) and the Jacobian's columns (k, n)."""
    model = unpack(vector, layout)
    x0 = vector[place.state]
    matrices = block_matrices(model.omega_rad_s, model.sigma_1_s, target.rate_hz)
    u = np.ascontiguousarray(delayed(target.inputs[record], model.delay_s * target.rate_hz).T)
    slopes = _delay_slopes(target, record, model, layout)
    m, n_u = layout.n_blocks, layout.n_inputs
    state = np.zeros((m, n_u + 2, 6))
    state[:, n_u, 0] = state[:, n_u + 1, 1] = 1.0
    for start in range(0, u.shape[1], _CHUNK):
        part = np.ascontiguousarray(u[:, start : start + _CHUNK])
        signals = np.empty((m, n_u + 2, 6, part.shape[1]))
        _block_signals(matrices.a, matrices.b, matrices.da, matrices.db, part, state, signals)
        slope = slopes[:, start : start + _CHUNK]
        yield start, [_columns(model, layout, place, x0, signals, part, slope, o) for o in range(layout.n_outputs)]


def _delay_slopes(target: TimeTarget, record: int, model: ModalModel, layout: Layout) -> Array:
    """Return the derivative of each output to each input's delay, (n_u · n_y, n), zero rows when delays are fixed."""
    n_u, n_y, n = layout.n_inputs, layout.n_outputs, target.inputs[record].shape[0]
    slopes = np.zeros((n_u, n_y, n))
    free = layout.free[layout.index("delay_s")]
    if np.any(free):
        bare = discretise(model.with_(delay_s=np.zeros(n_u)), target.rate_hz)
        for j in np.flatnonzero(free):
            taps = delay_taps(float(model.delay_s[j] * target.rate_hz))
            only = np.zeros((n, n_u))
            only[:, j] = target.rate_hz * weighted(target.inputs[record][:, j], taps.first, taps.slopes)
            slopes[j] = simulate_linear(bare, only).T
    return slopes.reshape(n_u * n_y, n)


def _columns(
    model: ModalModel,
    layout: Layout,
    place: Nuisance,
    x0: Array,
    signals: Array,
    u: Array,
    slope: Array,
    output: int,
) -> tuple[NDArray[np.intp], Array]:
    """Return the indices and the Jacobian (k, n) of one output over one chunk; the equations are modal_parameters'."""
    part, n_u, m = participation(model), layout.n_inputs, layout.n_blocks
    c, rate = model.c[output], model.c_rate[output]
    omega2 = model.omega_rad_s[:, None] ** 2
    n0, n1 = part.n0[:, output], part.n1[:, output]

    def weighted(on_q: Array, on_v: Array, free_q: Array, free_v: Array, pair: int) -> Array:
        """Sum over inputs of the pair's two signals under weights (m, n_u), free responses under (m,) times x0."""
        first = np.concatenate([on_q, free_q[:, None] * x0], axis=1)
        second = np.concatenate([on_v, free_v[:, None] * x0], axis=1)
        both = np.stack([first, second], axis=2).reshape(m, 1, -1)
        return (both @ signals[:, :, 2 * pair : 2 * pair + 2].reshape(m, -1, signals.shape[3]))[:, 0]

    none, one, zero = np.zeros((m, n_u)), np.ones(m), np.zeros(m)
    q, v = signals[:, :n_u, 0], signals[:, :n_u, 1]
    into_b = c[:, None, None] * q + rate[:, None, None] * v
    force = 2.0 * model.sigma_1_s[:, None]
    into_direct = (c[:, None] * force - omega2 * rate[:, None])[:, :, None] * q + c[:, None, None] * v
    start = c[:, None, None] * signals[:, n_u:, 0] + rate[:, None, None] * signals[:, n_u:, 1]
    by_omega = weighted(n0, n1, c, rate, 1) + weighted(part.n0_log_omega[:, output], none, zero, zero, 0)
    by_sigma = weighted(n0, n1, c, rate, 2) + weighted(part.n0_log_sigma[:, output], none, zero, zero, 0)
    by_c = weighted(part.force, model.b_direct, one, zero, 0)
    by_rate = weighted(-omega2 * model.b_direct, model.b, zero, one, 0)
    n = u.shape[1]
    columns = [by_omega, by_sigma, into_b.reshape(-1, n), into_direct.reshape(-1, n), by_c, by_rate, u]
    columns += [slope.reshape(n_u, layout.n_outputs, -1)[:, output], start.reshape(-1, n), np.ones((1, n))]
    names = [layout.index("log_omega"), layout.index("log_sigma"), layout.index("b").ravel()]
    names += [layout.index("b_direct").ravel(), layout.index("c")[output], layout.index("c_rate")[output]]
    names += [
        layout.index("d")[output],
        layout.index("delay_s"),
        place.state.ravel(),
        place.offset[output : output + 1],
    ]
    return np.concatenate(names), np.concatenate(columns)
