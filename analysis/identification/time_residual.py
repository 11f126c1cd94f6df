"""Output error of a ModalModel on time records: normal equations over parameters, initial states and offsets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.identification.block_basis import BlockMatrices, block_matrices
from analysis.identification.modal_parameters import Layout, participation, unpack
from analysis.identification.normal_equations import Normal
from analysis.linear.simulate import delayed, simulate_linear, weighted
from sim_backend.jit import njit
from sim_backend.linear import Array, ModalModel, discretise, played

# samples per pass: the Jacobian of one output over this many samples stays small enough for the cache
_CHUNK = 2048


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
    """Return the position of each record's nuisance parameters."""
    m, n_y = layout.n_blocks, layout.n_outputs
    size = 2 * m + n_y
    starts = layout.size + size * np.arange(records)
    return [Nuisance(np.arange(s, s + 2 * m).reshape(m, 2), np.arange(s + 2 * m, s + size)) for s in starts]


@njit
def _block_signals(
    a: Array, b: Array, da: Array, db: Array, late: Array, dlate: Array, u: Array, state: Array, out: Array
) -> None:
    """Step every block for every input with both sensitivities, `state` and `out` (m, n_u + 2, 6, …).

    The six are q, v and their derivatives to ln(omega) and ln(sigma). The last two inputs are zero: they carry the free
    responses to a unit initial position and rate. `u` (n_u, 1 + n) begins with the sample before the first: of `b` (m,
    2) and its derivatives `db` (2, m, 2) the older of two samples drives the part `late` (n_u, m, 2), `dlate`.
    """
    m, n_in, n = a.shape[0], state.shape[1], out.shape[3]
    for i in range(m):
        for j in range(n_in):
            q, v = state[i, j, 0], state[i, j, 1]
            qo, vo, qs, vs = state[i, j, 2], state[i, j, 3], state[i, j, 4], state[i, j, 5]
            driven = j < u.shape[0]
            split = driven and (late[j, i, 0] != 0.0 or late[j, i, 1] != 0.0)
            for k in range(n):
                drive = u[j, k + 1] if driven else 0.0
                out[i, j, 0, k], out[i, j, 1, k] = q, v
                out[i, j, 2, k], out[i, j, 3, k] = qo, vo
                out[i, j, 4, k], out[i, j, 5, k] = qs, vs
                nqo = a[i, 0, 0] * qo + a[i, 0, 1] * vo + da[0, i, 0, 0] * q + da[0, i, 0, 1] * v + db[0, i, 0] * drive
                nvo = a[i, 1, 0] * qo + a[i, 1, 1] * vo + da[0, i, 1, 0] * q + da[0, i, 1, 1] * v + db[0, i, 1] * drive
                nqs = a[i, 0, 0] * qs + a[i, 0, 1] * vs + da[1, i, 0, 0] * q + da[1, i, 0, 1] * v + db[1, i, 0] * drive
                nvs = a[i, 1, 0] * qs + a[i, 1, 1] * vs + da[1, i, 1, 0] * q + da[1, i, 1, 1] * v + db[1, i, 1] * drive
                nq = a[i, 0, 0] * q + a[i, 0, 1] * v + b[i, 0] * drive
                nv = a[i, 1, 0] * q + a[i, 1, 1] * v + b[i, 1] * drive
                if split:
                    more = u[j, k] - drive
                    nq, nv = nq + late[j, i, 0] * more, nv + late[j, i, 1] * more
                    nqo, nvo = nqo + dlate[j, 0, i, 0] * more, nvo + dlate[j, 0, i, 1] * more
                    nqs, nvs = nqs + dlate[j, 1, i, 0] * more, nvs + dlate[j, 1, i, 1] * more
                q, v, qo, vo, qs, vs = nq, nv, nqo, nvo, nqs, nvs
            state[i, j, 0], state[i, j, 1] = q, v
            state[i, j, 2], state[i, j, 3], state[i, j, 4], state[i, j, 5] = qo, vo, qs, vs


def model_outputs(target: TimeTarget, vector: Array, layout: Layout) -> list[Array]:
    """Return the model's output (n, n_y) for every record, initial states and offsets included."""
    discrete = played(unpack(vector, layout), target.rate_hz)
    places = nuisances(layout, len(target.inputs))
    return [
        simulate_linear(discrete, u, vector[place.state]) + vector[place.offset]
        for u, place in zip(target.inputs, places, strict=True)
    ]


def whitened_cost(target: TimeTarget, vector: Array, layout: Layout) -> float:
    """Return the sum of squares of the whitened error at a parameter `vector` (p,), nuisances of all records behind."""
    skip, cost = target.whitening.shape[1] - 1, 0.0
    for measured, modelled in zip(target.outputs, model_outputs(target, vector, layout), strict=True):
        for o in range(measured.shape[1]):
            error = scipy.signal.lfilter(target.whitening[o], [1.0], modelled[:, o] - measured[:, o])[skip:]
            cost += float(error @ error)
    return cost


def time_normal_equations(target: TimeTarget, vector: Array, layout: Layout) -> Normal:
    """Return cost, J'r (p,) and J'J (p, p) over the model's and all nuisance parameters, `vector` (p,)."""
    places = nuisances(layout, len(target.inputs))
    modelled = model_outputs(target, vector, layout)
    gradient, hessian, cost = np.zeros(vector.size), np.zeros((vector.size, vector.size)), 0.0
    for r, place in enumerate(places):
        error = modelled[r] - target.outputs[r]
        for index, products in _products(target, r, error, vector, layout, place):
            cost += float(products[-1, -1])
            gradient[index] += products[:-1, -1]
            hessian[np.ix_(index, index)] += products[:-1, :-1]
    return Normal(cost, gradient, hessian)


def _products(
    target: TimeTarget, record: int, error: Array, vector: Array, layout: Layout, place: Nuisance
) -> Iterator[tuple[NDArray[np.intp], Array]]:
    """Yield per output the indices (k,) and the products (k + 1, k + 1) of whitened Jacobian and `error` (n, n_y).

    All work is done a chunk at a time in the same few arrays: new ones of this size cost as much as the arithmetic.
    """
    model = unpack(vector, layout)
    matrices = block_matrices(model.omega_rad_s, model.sigma_1_s, target.rate_hz)
    late, dlate = _older(model, matrices, target.rate_hz)
    whole = np.floor(model.delay_s * target.rate_hz)
    u = delayed(target.inputs[record], whole).T
    u = np.ascontiguousarray(np.concatenate([np.zeros((u.shape[0], 1)), u], axis=1))
    instant = np.where((model.delay_s * target.rate_hz > whole)[:, None], u[:, :-1], u[:, 1:])
    slopes = _delay_slopes(target, record, model, layout)
    m, n_u, n = layout.n_blocks, layout.n_inputs, instant.shape[1]
    weights = [_weights(model, vector[place.state], o) for o in range(layout.n_outputs)]
    k, skip, chunk = m * weights[0].shape[1] + 2 * n_u + 2, target.whitening.shape[1] - 1, min(_CHUNK, n)
    # before its first sample a record has no samples; the first `skip` of a chunk are the last of the one before
    rows, white = np.zeros((layout.n_outputs, k, skip + chunk)), np.empty((k, chunk))
    state, room = np.zeros((m, n_u + 2, 6)), np.empty(m * (n_u + 2) * 6 * chunk)
    state[:, n_u, 0] = state[:, n_u + 1, 1] = 1.0
    products = np.zeros((layout.n_outputs, k, k))
    for start in range(0, n, chunk):
        part = slice(start, min(start + chunk, n))
        size = part.stop - start
        signals = room[: state.size * size].reshape(*state.shape, size)
        drive = np.ascontiguousarray(u[:, start : part.stop + 1])
        _block_signals(matrices.a, matrices.b, matrices.da, matrices.db, late, dlate, drive, state, signals)
        for o in range(layout.n_outputs):
            own = rows[o, :, : skip + size]
            own[:, :skip] = rows[o, :, chunk:]
            _fill(own[:, skip:], weights[o], signals, instant[:, part], slopes[:, o, part], error[part, o])
            _filtered(target.whitening[o], own, white[:, :size])
            known = white[:, max(skip - start, 0) : size]
            products[o] += known @ known.T
    yield from zip((_indices(layout, place, o) for o in range(layout.n_outputs)), products, strict=True)


@njit
def _filtered(taps: Array, rows: Array, out: Array) -> None:
    """Fill `out` (k, n) with `rows` (k, p + n) filtered by `taps` (p + 1,)."""
    skip, n = taps.size - 1, out.shape[1]
    for j in range(out.shape[0]):
        now, of = out[j], rows[j, skip:]
        for i in range(n):
            now[i] = taps[0] * of[i]
        for lag in range(1, skip + 1):
            past, weight = rows[j, skip - lag :], taps[lag]
            for i in range(n):
                now[i] += weight * past[i]


def _older(model: ModalModel, matrices: BlockMatrices, rate_hz: float) -> tuple[Array, Array]:
    """Return what the older of two held samples drives of every block, (n_u, m, 2), with derivatives (n_u, 2, m, 2).

    A delay of parts of a sample lets it act for the first part of the next one. The derivatives are to ln(omega) and
    ln(sigma); all are zero where a delay is a whole number of samples.
    """
    late = np.zeros((model.n_inputs, *matrices.b.shape))
    dlate = np.zeros((model.n_inputs, *matrices.db.shape))
    for j, part in enumerate(np.mod(model.delay_s * rate_hz, 1.0)):
        if part > 0.0:
            newer = block_matrices(model.omega_rad_s, model.sigma_1_s, rate_hz / (1.0 - part))
            late[j], dlate[j] = matrices.b - newer.b, matrices.db - newer.db
    return late, dlate


def _delay_slopes(target: TimeTarget, record: int, model: ModalModel, layout: Layout) -> Array:
    """Return the derivative of each output to each input's delay, (n_u, n_y, n), zero rows when delays are fixed."""
    n_u, n_y, n = layout.n_inputs, layout.n_outputs, target.inputs[record].shape[0]
    slopes = np.zeros((n_u, n_y, n))
    free = layout.free[layout.index("delay_s")]
    if np.any(free):
        bare = discretise(model.with_(delay_s=np.zeros(n_u), d=np.zeros_like(model.d)), target.rate_hz)
        into = np.stack([model.b_direct, model.b], axis=1)
        for j in np.flatnonzero(free):
            whole, part = divmod(float(model.delay_s[j] * target.rate_hz), 1.0)
            # the older sample acts longer, the newer one begins later: what that moves coasts to the next sample
            rest = block_matrices(model.omega_rad_s, model.sigma_1_s, target.rate_hz / max(1.0 - part, 1e-12)).a
            older = weighted(target.inputs[record][:, j], int(whole), np.array([-1.0, 1.0]))
            alone = replace(bare, b=rest @ into[:, :, [j]], d=bare.d[:, [j]], delay_samples=np.zeros(1))
            slopes[j] = simulate_linear(alone, older[:, None]).T
    return slopes


def _weights(model: ModalModel, x0: Array, output: int) -> Array:
    """Return how each block's signals add up to the derivatives of one output, (m, 2 n_u + 6, 6 n_u + 12).

    The equations are modal_parameters'. `x0` (m, 2) are the states at the first sample. Rows are in the order of
    `_indices`, signals in that of `_block_signals`.
    """
    part = participation(model)
    m, n_u = model.b.shape
    c, rate, omega2 = model.c[output], model.c_rate[output], model.omega_rad_s[:, None] ** 2
    out = np.zeros((m, 2 * n_u + 6, n_u + 2, 6))
    for row, first, changed in ((0, 2, part.n0_log_omega), (1, 4, part.n0_log_sigma)):
        out[:, row, :n_u, first], out[:, row, :n_u, first + 1] = part.n0[:, output], part.n1[:, output]
        out[:, row, n_u:, first], out[:, row, n_u:, first + 1] = c[:, None] * x0, rate[:, None] * x0
        out[:, row, :n_u, 0] = changed[:, output]
    for j in range(n_u):
        out[:, 2 + j, j, 0], out[:, 2 + j, j, 1] = c, rate
        out[:, 2 + n_u + j, j, 0] = 2.0 * model.sigma_1_s * c - omega2[:, 0] * rate
        out[:, 2 + n_u + j, j, 1] = c
    by_c, by_rate = out[:, 2 + 2 * n_u], out[:, 3 + 2 * n_u]
    by_c[:, :n_u, 0], by_c[:, :n_u, 1], by_c[:, n_u:, 0] = part.force, model.b_direct, x0
    by_rate[:, :n_u, 0], by_rate[:, :n_u, 1], by_rate[:, n_u:, 1] = -omega2 * model.b_direct, model.b, x0
    for i in range(2):
        out[:, 4 + 2 * n_u + i, n_u + i, 0], out[:, 4 + 2 * n_u + i, n_u + i, 1] = c, rate
    return out.reshape(m, 2 * n_u + 6, -1)


def _indices(layout: Layout, place: Nuisance, output: int) -> NDArray[np.intp]:
    """Return the indices of the derivatives of one output in the vector: block by block, then the others."""
    own = [layout.index(name)[:, None] for name in ("log_omega", "log_sigma")]
    own += [layout.index("b"), layout.index("b_direct")]
    own += [layout.index(name)[output][:, None] for name in ("c", "c_rate")]
    blocks = np.concatenate([*own, place.state], axis=1).ravel()
    rest = layout.index("d")[output], layout.index("delay_s"), place.offset[output : output + 1]
    return np.concatenate([blocks, *rest])


def _fill(rows: Array, weights: Array, signals: Array, u: Array, slopes: Array, error: Array) -> None:
    """Fill `rows` (k + 1, n) with the derivatives of one output, in the order of `_indices`, and its `error` (n,)."""
    (m, each, _), n_u = weights.shape, u.shape[0]
    blocks = rows[: m * each]
    for i in range(m):
        np.matmul(weights[i], signals[i].reshape(weights.shape[2], -1), out=blocks[i * each : (i + 1) * each])
    rest = rows[m * each :]
    rest[:n_u], rest[n_u : 2 * n_u], rest[2 * n_u], rest[2 * n_u + 1] = u, slopes, 1.0, error
