"""From any state space to the sum of second-order blocks, and to one choice of its coordinates."""

from __future__ import annotations

import math

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
    at = np.where(poles.real > 0.0, -poles.conj(), poles).tolist()
    into, out = inputs.tolist(), outputs.tolist()
    blocks = []
    # eigenvectors of the companion block are (1, p); of a complex pair, the second one is the conjugate of the first
    for pole, b, c in zip(at, into, out, strict=True):
        if pole.imag > 0.0:
            rate = [y.imag / pole.imag for y in c]
            place = [y.real - pole.real * slope for y, slope in zip(c, rate, strict=True)]
            drive = [2.0 * (pole * u).real for u in b], [2.0 * u.real for u in b]
            blocks.append((abs(pole), -pole.real, *drive, place, rate))
    real = sorted((k for k, pole in enumerate(at) if pole.imag == 0.0), key=lambda k: at[k].real)
    for i, k in zip(real[::2], real[1::2], strict=True):
        p, q = at[i].real, at[k].real
        if abs(p - q) < 1e-6 * abs(p):
            p, q = p * (1.0 + 1e-6), q * (1.0 - 1e-6)
        rate = [(v.real - y.real) / (q - p) for y, v in zip(out[i], out[k], strict=True)]
        place = [y.real - p * slope for y, slope in zip(out[i], rate, strict=True)]
        drive = (
            [p * u.real + q * w.real for u, w in zip(into[i], into[k], strict=True)],
            [u.real + w.real for u, w in zip(into[i], into[k], strict=True)],
        )
        blocks.append((math.sqrt(max(p * q, 0.0)), -0.5 * (p + q), *drive, place, rate))
    blocks.sort(key=lambda block: block[0])
    omega, sigma, b, direct, c, c_rate = (np.array([block[k] for block in blocks]) for k in range(6))
    m, n_u, n_y = len(blocks), inputs.shape[1], outputs.shape[1]
    model = ModalModel(
        omega,
        sigma,
        b.reshape(m, n_u),
        direct.reshape(m, n_u),
        c.reshape(m, n_y).T.copy(),
        c_rate.reshape(m, n_y).T.copy(),
        np.asarray(d, dtype=float).copy(),
        np.zeros(n_u),
    )
    return canonical(model)


def canonical(model: ModalModel) -> ModalModel:
    """Return the same system with each block's free choice of coordinates made unique.

    States may be multiplied by T = alpha I + beta A, which commutes with the block A: for a complex pair that is a
    complex factor between input and output. T is chosen so that the input that drives the block most has b = 1 and
    b_direct = 0; a mechanical mode then has b_direct = c_rate = 0. Where that input moves only one of two real poles,
    no such T exists, and the block is only scaled.
    """
    b, direct, c, rate = (a.tolist() for a in (model.b, model.b_direct, model.c.T, model.c_rate.T))
    # a handful of numbers for each block: numpy would take longer to be called than to compute
    for i, (omega, sigma) in enumerate(zip(model.omega_rad_s.tolist(), model.sigma_1_s.tolist(), strict=True)):
        squares = [into * into + (omega * first) ** 2 for into, first in zip(b[i], direct[i], strict=True)]
        cross = [2.0 * sigma * into * first for into, first in zip(b[i], direct[i], strict=True)]
        strongest = max(range(len(squares)), key=lambda k: abs(squares[k] + cross[k]))
        most, mixed = squares[strongest], cross[strongest]
        if abs(most + mixed) <= 1e-6 * (most + abs(mixed)):
            size = max(*map(abs, b[i]), *(omega * abs(first) for first in direct[i])) or 1.0
            b[i], direct[i] = [into / size for into in b[i]], [first / size for first in direct[i]]
            c[i], rate[i] = [out * size for out in c[i]], [out * size for out in rate[i]]
            continue
        stiffness, drag = -omega * omega, -2.0 * sigma
        first, into = direct[i][strongest], b[i][strongest]
        alpha, beta = _solved((first, into), (into, stiffness * first + drag * into), (0.0, 1.0))
        # T by its rows
        above, below = (alpha, beta), (beta * stiffness, alpha + beta * drag)
        drive = list(zip(direct[i], b[i], strict=True))
        direct[i] = [above[0] * first + above[1] * into for first, into in drive]
        b[i] = [below[0] * first + below[1] * into for first, into in drive]
        seen = [_solved(above, below, out) for out in zip(c[i], rate[i], strict=True)]
        c[i], rate[i] = [out[0] for out in seen], [out[1] for out in seen]
        direct[i][strongest], b[i][strongest] = 0.0, 1.0
    made = [np.array(a, dtype=float).reshape(shape) for a, shape in (
        (b, model.b.shape), (direct, model.b.shape), (c, model.c.T.shape), (rate, model.c.T.shape)
    )]  # fmt: skip
    return model.with_(b=made[0], b_direct=made[1], c=made[2].T.copy(), c_rate=made[3].T.copy())


def _solved(
    first: tuple[float, float], second: tuple[float, float], values: tuple[float, float]
) -> tuple[float, float]:
    """Return x with first x[0] + second x[1] = values, by elimination with the larger pivot."""
    (a, c), (b, d), (p, q) = first, second, values
    if abs(c) > abs(a):
        a, b, p, c, d, q = c, d, q, a, b, p
    factor = c / a
    last = (q - factor * p) / (d - factor * b)
    return (p - b * last) / a, last


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
    """Return the one block of a `pole` (s⁻¹, imaginary part positive) nearest to (n0 + n1 s) / ((s - p)(s - p*)).

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
