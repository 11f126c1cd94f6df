"""Position and rate of each second-order block under a unit force, as spectra with derivatives.

One formula serves both worlds: x = (lambda I - A)^-1 b, with lambda = s and the companion block for a continuous
(band-limited) measurement, or lambda = z and the exact zero-order-hold equivalent for a sampled one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from sim_backend.linear import Array

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True)
class BlockMatrices:
    """A (m, 2, 2) and b (m, 2) of each block with derivatives to ln(omega) and ln(sigma), `da` (2, m, 2, 2), `db` (2, m, 2)."""

    a: Array
    b: Array
    da: Array
    db: Array


def block_matrices(omega_rad_s: Array, sigma_1_s: Array, hold_rate_hz: float | None) -> BlockMatrices:
    """Return the matrices of blocks driven by a unit force, continuous or behind a zero-order hold.

    Behind a hold, [A E; 0 A] is exponentiated, whose upper right block is the exact derivative in direction E
    (Van Loan 1978); it needs no case for rigid bodies or equal poles.
    """
    m = omega_rad_s.size
    joint = np.zeros((m, 3, 3))
    joint[:, 0, 1] = 1.0
    joint[:, 1, 0], joint[:, 1, 1], joint[:, 1, 2] = -(omega_rad_s**2), -2.0 * sigma_1_s, 1.0
    slope = np.zeros((2, m, 3, 3))
    slope[0, :, 1, 0], slope[1, :, 1, 1] = -2.0 * omega_rad_s**2, -2.0 * sigma_1_s
    if hold_rate_hz is None:
        return BlockMatrices(joint[:, :2, :2], joint[:, :2, 2], slope[:, :, :2, :2], slope[:, :, :2, 2])
    doubled = np.zeros((2, m, 6, 6))
    doubled[:, :, :3, :3] = doubled[:, :, 3:, 3:] = joint
    doubled[:, :, :3, 3:] = slope
    # the rate state is scaled to the size of the position state, so that one norm is fair to both
    unit = np.tile([hold_rate_hz, 1.0, 1.0], 2)
    step = expm(doubled * (unit[:, None] / unit) / hold_rate_hz) * (unit / unit[:, None])
    return BlockMatrices(step[0, :, :2, :2], step[0, :, :2, 2], step[:, :, :2, 3:5], step[:, :, :2, 5])


def block_spectra(matrices: BlockMatrices, point: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return (q, v) as (2, m, n_f) and their derivatives to ln(omega), ln(sigma) as (2, 2, m, n_f) at lambda = `point`."""
    state = _resolve(matrices.a, point, matrices.b[:, 0, None], matrices.b[:, 1, None])
    slopes = np.empty((2, *state.shape), dtype=complex)
    for k in range(2):
        drive = np.einsum("mij,jmf->imf", matrices.da[k], state) + matrices.db[k].T[:, :, None]
        slopes[k] = _resolve(matrices.a, point, drive[0], drive[1])
    return state, slopes


def _resolve(a: Array, point: ComplexArray, first: NDArray, second: NDArray) -> ComplexArray:
    """Return (lambda I - A)^-1 [first, second], shape (2, m, n_f), by Cramer's rule for the 2 × 2 block."""
    e = a[:, :, :, None]
    top, bottom = point - e[:, 0, 0], point - e[:, 1, 1]
    determinant = top * bottom - e[:, 0, 1] * e[:, 1, 0]
    return np.stack([bottom * first + e[:, 0, 1] * second, e[:, 1, 0] * first + top * second]) / determinant
