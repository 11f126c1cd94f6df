"""Predictor-based subspace identification: a state space from any record, in open or closed loop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.linear.modal_form import modal_from_poles
from sim_backend.errors import DataError
from sim_backend.linear import Array, ModalModel


def subspace_model(inputs: Sequence[Array], outputs: Sequence[Array], rate_hz: float, order: int) -> ModalModel:
    """Return a ModalModel of even `order` from records (n, n_u) and (n, n_y), exact behind a zero-order hold.

    PBSID (Chiuso 2007): a long autoregression with input gives the predictor's Markov parameters without bias from
    feedback; the states follow from their singular value decomposition, the matrices by least squares. Raises
    DataError when the records are too short for the order.
    """
    n_u, n_y = inputs[0].shape[1], outputs[0].shape[1]
    total = sum(u.shape[0] for u in inputs)
    past = int(np.clip(2 * order // n_y + 4, 6, max(total // (4 * (n_u + n_y)), 1)))
    if past * n_y < order + n_y or min(u.shape[0] for u in inputs) < 3 * past:
        raise DataError(
            f"{total} samples are too few for a start with {order} states; record more or ask for fewer blocks"
        )
    rows = [_regression(u - u.mean(axis=0), y - y.mean(axis=0), past) for u, y in zip(inputs, outputs, strict=True)]
    history, now_u, now_y = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    markov = scipy.linalg.lstsq(np.concatenate([history, now_u], axis=1), now_y, cond=1e-12)[0][: past * (n_u + n_y)].T
    # row block i of observability times controllability: Markov parameters shifted i steps into the past
    width = n_u + n_y
    product = np.zeros((past * n_y, past * width))
    for i in range(past):
        product[i * n_y : (i + 1) * n_y, i * width :] = markov[:, : (past - i) * width]
    _, size, right = scipy.linalg.svd(product @ history.T, full_matrices=False)
    states = right[:order].T * np.sqrt(size[:order])
    c, d, a, b = _matrices(states, now_u, now_y, [r[1].shape[0] for r in rows], order)
    return _continuous(a, b, c, d, rate_hz)


def _regression(u: Array, y: Array, past: int) -> tuple[Array, Array, Array]:
    """Return the past (rows, past · (n_u + n_y)), oldest first, with the input and output of each row's sample."""
    both = np.concatenate([u, y], axis=1)
    view = np.lib.stride_tricks.sliding_window_view(both, past, axis=0)[:-1]
    return view.transpose(0, 2, 1).reshape(view.shape[0], -1), u[past:], y[past:]


def _matrices(
    states: Array, u: Array, y: Array, lengths: Sequence[int], order: int
) -> tuple[Array, Array, Array, Array]:
    """Return (C, D, A, B) by least squares on the states, with the innovation as a further input to them."""
    joint = np.concatenate([states, u], axis=1)
    out = scipy.linalg.lstsq(joint, y)[0].T
    innovation = y - joint @ out.T
    end = np.cumsum(lengths)
    step = np.setdiff1d(np.arange(states.shape[0]), end - 1)
    found = scipy.linalg.lstsq(np.concatenate([joint, innovation], axis=1)[step], states[step + 1])[0].T
    n_u = u.shape[1]
    return out[:, :order], out[:, order:], found[:, :order], found[:, order : order + n_u]


def _continuous(a: Array, b: Array, c: Array, d: Array, rate_hz: float) -> ModalModel:
    """Return the ModalModel whose zero-order-hold equivalent has these matrices, poles moved inside the unit circle."""
    z, right = np.linalg.eig(a)
    into, out = np.linalg.solve(right, b.astype(complex)), c @ right
    size = np.abs(z)
    z = np.where(size > 1.0, z / size**2, z)
    # single negative real poles have no continuous equivalent; they and pure delays become fast real ones
    z = np.where((z.imag == 0.0) & (z.real < 1e-3), np.clip(np.abs(z.real), 1e-3, 1.0), z)
    z = np.where(np.abs(z) > 1.0 - 1e-9, z * (1.0 - 1e-9), z)
    poles: NDArray[np.complex128] = np.log(z)
    residue_scale = poles / np.expm1(poles)
    return modal_from_poles(poles * rate_hz, (out * residue_scale * rate_hz).T, into, d)
