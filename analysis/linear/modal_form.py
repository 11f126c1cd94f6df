"""From any state space to the sum of second-order blocks, and to one choice of its coordinates."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from sim_backend.errors import DataError
from sim_backend.linear import Array, ModalModel

ComplexArray = NDArray[np.complex128]


def modal_from_state_space(a: Array, b: Array, c: Array, d: Array) -> ModalModel:
    """Return the ModalModel of a continuous state space with an even number of distinct eigenvalues.

    Shapes: `a` (n, n), `b` (n, n_u), `c` (n_y, n), `d` (n_y, n_u). Raises DataError when the order is odd or an
    eigenvalue is defective to working precision.
    """
    values, right = np.linalg.eig(a)
    if values.size % 2:
        raise DataError(f"state space has odd order {values.size}; second-order blocks need an even number of states")
    if np.linalg.cond(right) > 1e14:
        raise DataError(
            "state space has repeated eigenvalues without enough eigenvectors; perturb it or reduce its order"
        )
    return modal_from_poles(values, (c @ right).T, np.linalg.solve(right, b.astype(complex)), d)


def modal_from_poles(poles: ComplexArray, outputs: ComplexArray, inputs: ComplexArray, d: Array) -> ModalModel:
    """Return the ModalModel of sum over k of outputs[k] inputs[k]' / (s - poles[k]) + d.

    Shapes: `poles` (n,), closed under conjugation; `outputs` (n, n_y); `inputs` (n, n_u); `d` (n_y, n_u). Right-half
    plane poles are reflected.
    """
    poles = np.where(poles.real > 0.0, -poles.conj(), poles)
    upper = np.flatnonzero(poles.imag > 0.0)
    real = np.flatnonzero(poles.imag == 0.0)
    real = real[np.argsort(poles[real].real)]
    omega, sigma, rows_b, rows_c = [], [], [], []
    for i, k in [*((i, None) for i in upper), *zip(real[::2], real[1::2], strict=True)]:
        pair = np.array([poles[i], poles[i].conj() if k is None else poles[k]])
        if k is not None and abs(pair[0] - pair[1]) < 1e-6 * abs(pair[0]):
            pair = pair * np.array([1.0 + 1e-6, 1.0 - 1e-6])
        left = np.stack([inputs[i], inputs[i].conj() if k is None else inputs[k]])
        out = np.stack([outputs[i], outputs[i].conj() if k is None else outputs[k]])
        # eigenvectors of the companion block are (1, p)
        vectors = np.array([[1.0, 1.0], pair])
        rows_b.append((vectors @ left).real)
        rows_c.append(np.linalg.solve(vectors.T, out).real)
        omega.append(np.sqrt(max((pair[0] * pair[1]).real, 0.0)))
        sigma.append(-0.5 * (pair[0] + pair[1]).real)
    n_u, n_y = inputs.shape[1], outputs.shape[1]
    bb, cc = np.array(rows_b).reshape(-1, 2, n_u), np.array(rows_c).reshape(-1, 2, n_y)
    order = np.argsort(omega)
    model = ModalModel(
        np.array(omega)[order],
        np.array(sigma)[order],
        bb[order, 1],
        bb[order, 0],
        cc[order, 0].T.copy(),
        cc[order, 1].T.copy(),
        np.asarray(d, dtype=float).copy(),
        np.zeros(n_u),
    )
    return canonical(model)


def canonical(model: ModalModel) -> ModalModel:
    """Return the same system with each block's free choice of coordinates made one way.

    States may be multiplied by T = alpha I + beta A, which commutes with the block A: for a complex pair that is a
    complex factor between input and output. T is chosen so that the input that drives the block most has b = 1 and
    b_direct = 0; a mechanical mode then has b_direct = c_rate = 0. Where that input moves only one of two real poles,
    no such T exists, and the block is only scaled.
    """
    b, direct, c, rate = model.b.copy(), model.b_direct.copy(), model.c.copy(), model.c_rate.copy()
    for i in range(model.n_blocks):
        omega, sigma = model.omega_rad_s[i], model.sigma_1_s[i]
        squares = b[i] ** 2 + (omega * direct[i]) ** 2
        cross = 2.0 * sigma * b[i] * direct[i]
        strongest = int(np.argmax(np.abs(squares + cross)))
        if abs(squares[strongest] + cross[strongest]) <= 1e-6 * (squares[strongest] + abs(cross[strongest])):
            size = max(np.max(np.abs(b[i])), omega * np.max(np.abs(direct[i]))) or 1.0
            b[i], direct[i] = b[i] / size, direct[i] / size
            c[:, i], rate[:, i] = c[:, i] * size, rate[:, i] * size
            continue
        block, drive = model.block(i), np.array([direct[i], b[i]])
        pair = np.stack([drive[:, strongest], block @ drive[:, strongest]], axis=1)
        alpha, beta = np.linalg.solve(pair, np.array([0.0, 1.0]))
        turn = alpha * np.eye(2) + beta * block
        direct[i], b[i] = turn @ drive
        c[:, i], rate[:, i] = np.linalg.solve(turn.T, np.array([c[:, i], rate[:, i]]))
        direct[i, strongest], b[i, strongest] = 0.0, 1.0
    return model.with_(b=b, b_direct=direct, c=c, c_rate=rate)


def balanced_truncation(
    a: Array, b: Array, c: Array, order: int, shift_1_s: float
) -> tuple[Array, Array, Array, Array]:
    """Return (A, B, C) of the given order and all Hankel singular values, largest first.

    Square-root method (Laub, Heath, Paige & Ward 1987). The Gramians are those of A - shift, which exist also for
    integrators and rigid bodies; choose the shift below the lowest frequency of interest. Raises DataError when a
    Gramian cannot be computed.
    """
    shifted = a - shift_1_s * np.eye(a.shape[0])
    control = _factor(scipy.linalg.solve_continuous_lyapunov(shifted, -b @ b.T))
    observe = _factor(scipy.linalg.solve_continuous_lyapunov(shifted.T, -c.T @ c))
    left, hankel, right = scipy.linalg.svd(observe.T @ control)
    keep = min(order, int(np.sum(hankel > 1e-14 * hankel[0])))
    root = np.sqrt(hankel[:keep])
    to_full, to_small = control @ right[:keep].T / root, (observe @ left[:, :keep] / root).T
    return to_small @ a @ to_full, to_small @ b, c @ to_full, hankel


def _factor(gramian: Array) -> Array:
    """Return a square root of a Gramian whose smallest eigenvalues may be rounded below zero."""
    if not np.all(np.isfinite(gramian)):
        raise DataError("model reduction: a Gramian is not finite; the fit has poles on the imaginary axis")
    values, vectors = np.linalg.eigh(0.5 * (gramian + gramian.T))
    return vectors * np.sqrt(np.maximum(values, 0.0))


def block_of(pole: complex, n0: Array, n1: Array, *, mechanical: bool) -> ModalModel:
    """Return the one block of a `pole` (1/s, imaginary part positive) nearest to (n0 + n1 s) / ((s - p)(s - p*)).

    `n0` and `n1` (n_y, n_u); a block takes part by one pattern of inputs and one of outputs, the strongest of both. A
    `mechanical` one has no direct parts.
    """
    # the residue of the pole
    left, size, right = np.linalg.svd((n0 + n1 * pole) / (2j * pole.imag))
    out, into = left[:, 0] * size[0], right[0]
    if mechanical:
        turn = np.exp(-1j * np.angle(into[np.argmax(np.abs(into))])) / 1j
        into, out = into * turn, out / turn
    both = np.array([pole, pole.conjugate()])
    block = modal_from_poles(both, np.stack([out, out.conj()]), np.stack([into, into.conj()]), np.zeros_like(n0))
    if mechanical:
        return block.with_(b_direct=np.zeros_like(block.b_direct), c_rate=np.zeros_like(block.c_rate))
    return block
