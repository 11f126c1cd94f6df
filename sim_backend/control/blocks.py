"""A discrete controller with one input and one output, held as a sum of second-order blocks.

    x_i[k+1] = a_i x_i[k] + b_i u[k],    y[k] = sum over blocks of c_i x_i[k] + d u[k]

The sum keeps an integrator in a block of its own, so that the hybrid strategy can set its state alone, and it
runs in the same compiled recursion as the plant. The integrator's state is scaled so that it *is* its
contribution to the output.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim_backend.errors import ConfigError
from sim_backend.polynomial import block_numerator, real_pairs, scaled_roots

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_INTEGRATOR_TOLERANCE = 1e-9
"""How near to z = 1 a pole must lie to count as the integrator: 1e-9 at 10 kHz is a leak over 28 hours."""


@dataclass(frozen=True)
class DiscreteFilter:
    """A discrete filter of `m` blocks at one sample rate.

    Shapes: `a` (m, 2, 2), `b` and `c` (m, 2), `d` a number. `integrator` is the index of the block whose
    first state is an integrator in units of the output, or None. Raises ConfigError when a shape does not
    fit, a number is not finite, the rate is not positive or the named block is not an integrator.
    """

    a: Array
    b: Array
    c: Array
    d: float
    rate_hz: float
    integrator: int | None = None

    def __post_init__(self) -> None:
        m = self.b.shape[0]
        for name, shape in (("a", (m, 2, 2)), ("b", (m, 2)), ("c", (m, 2))):
            value = getattr(self, name)
            if value.shape != shape:
                raise ConfigError(f"filter: {name} has shape {value.shape}, needs {shape}; give one entry per block")
            if not np.all(np.isfinite(value)):
                raise ConfigError(f"filter: {name} holds a number that is not finite; check poles, zeros and gain")
        if not (np.isfinite(self.d) and np.isfinite(self.rate_hz) and self.rate_hz > 0.0):
            raise ConfigError(
                f"filter: direct gain {self.d} and rate {self.rate_hz} Hz must be finite, the rate above zero"
            )
        if self.integrator is not None:
            i = self.integrator
            if not (0 <= i < m and self.a[i, 0, 0] == 1.0 and self.a[i, 0, 1] == 0.0 and self.c[i, 0] == 1.0):
                raise ConfigError(f"filter: block {i} of {m} is not an integrator; name another block or None")

    @property
    def n_blocks(self) -> int:
        """Number of second-order blocks."""
        return int(self.b.shape[0])

    def poles(self) -> ComplexArray:
        """Return the eigenvalues of all blocks in z, shape (2 m,); an unused second state shows as zero."""
        return np.asarray(np.linalg.eigvals(self.a).reshape(-1), dtype=complex)

    def scaled(self, gain: float) -> DiscreteFilter:
        """Return the filter times `gain`; the integrator's state stays in units of the output."""
        keep = np.zeros(self.n_blocks, dtype=bool)
        if self.integrator is not None:
            keep[self.integrator] = True
        b = np.where(keep[:, None], self.b * gain, self.b)
        c = np.where(keep[:, None], self.c, self.c * gain)
        return DiscreteFilter(self.a, b, c, self.d * gain, self.rate_hz, self.integrator)

    def frequency_response(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return the complex response, shape (n_f,); infinite at 0 Hz with an integrator."""
        z = np.exp(2j * np.pi * np.asarray(frequency_hz, dtype=float) / self.rate_hz)
        a, b, c = self.a, self.b, self.c
        # Cramer's rule for (zI - a)^-1 b, block by block
        determinant = (z[:, None] - a[:, 0, 0]) * (z[:, None] - a[:, 1, 1]) - a[:, 0, 1] * a[:, 1, 0]
        x0 = (z[:, None] - a[:, 1, 1]) * b[:, 0] + a[:, 0, 1] * b[:, 1]
        x1 = a[:, 1, 0] * b[:, 0] + (z[:, None] - a[:, 0, 0]) * b[:, 1]
        return np.asarray(((c[:, 0] * x0 + c[:, 1] * x1) / determinant).sum(axis=1) + self.d, dtype=complex)

    def state_space(self) -> tuple[Array, Array, Array, Array]:
        """Return (A, B, C, D), shapes (2m, 2m), (2m, 1), (1, 2m), (1, 1), block-diagonal."""
        m = self.n_blocks
        a = np.zeros((2 * m, 2 * m))
        for i in range(m):
            a[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = self.a[i]
        return a, self.b.reshape(-1, 1), self.c.reshape(1, -1), np.array([[self.d]])


def filter_from_zpk(zeros: ArrayLike, poles: ArrayLike, gain: float, rate_hz: float) -> DiscreteFilter:
    """Return gain Π(z - zeros) / Π(z - poles) as blocks; a pole at z = 1 becomes the integrator block.

    Zeros are (m,), poles (n,). Raises ConfigError when the fraction is improper, roots are not conjugate, or a pole is
    repeated more than a block of two can hold (a double integrator among them).
    """
    zs, ps = np.asarray(zeros, dtype=complex), np.asarray(poles, dtype=complex)
    if zs.size > ps.size:
        raise ConfigError(
            f"filter: {zs.size} zeros over {ps.size} poles needs the future; add {zs.size - ps.size} poles"
        )
    at_one = np.abs(ps - 1.0) < _INTEGRATOR_TOLERANCE
    if np.count_nonzero(at_one) > 1:
        raise ConfigError(
            f"filter: {np.count_nonzero(at_one)} poles at z = 1; one integrator is the limit, move the others"
        )
    ps = np.where(at_one, 1.0, ps)
    pairs = real_pairs(ps, alone=(1.0 + 0.0j,) if at_one.any() else ())
    integrator = 0 if at_one.any() else None
    m = len(pairs)
    a, b, c = np.zeros((m, 2, 2)), np.zeros((m, 2)), np.zeros((m, 2))
    for i, (p1, p2) in enumerate(pairs):
        others = [p for j, both in enumerate(pairs) if j != i for p in both if p is not None]
        n1, n0 = block_numerator((p1, p2), zs, others, gain)
        if p2 is None:
            a[i, 0, 0], b[i, 0], c[i, 0] = p1.real, n0, 1.0
        else:
            a[i] = [[0.0, 1.0], [-(p1 * p2).real, (p1 + p2).real]]
            b[i], c[i] = [0.0, 1.0], [n0, n1]
    return DiscreteFilter(a, b, c, float(gain) if zs.size == ps.size else 0.0, float(rate_hz), integrator)


def filter_from_tf(numerator: ArrayLike, denominator: ArrayLike, rate_hz: float) -> DiscreteFilter:
    """Return numerator(z)/denominator(z), highest power first, as blocks.

    Coefficients are (m,) and (n,). Only for coefficients in full digits: printed ones can move a pole across the unit
    circle. Raises ConfigError as `filter_from_zpk` does.
    """
    num, den = (
        np.atleast_1d(np.asarray(numerator, dtype=float)),
        np.atleast_1d(np.asarray(denominator, dtype=float)),
    )
    return filter_from_zpk(scaled_roots(num), scaled_roots(den), float(num[0] / den[0]), rate_hz)


def filter_from_state_space(a: ArrayLike, b: ArrayLike, c: ArrayLike, d: ArrayLike, rate_hz: float) -> DiscreteFilter:
    """Return c (zI - a)^-1 b + d of one input and one output as blocks, by the eigenvectors of `a` (n, n).

    A pole at z = 1 becomes the integrator block. Raises ConfigError when the eigenvectors do not span the states, as
    with repeated poles: the blocks would then give another response.
    """
    states, into = np.asarray(a, dtype=float), np.asarray(b, dtype=float).reshape(-1, 1)
    out, direct = np.asarray(c, dtype=float).reshape(1, -1), float(np.asarray(d, dtype=float).reshape(()))
    poles, vectors = np.linalg.eig(states)
    residues = (out @ vectors)[0] * np.linalg.solve(vectors, into.astype(complex))[:, 0]
    at_one = np.abs(poles - 1.0) < _INTEGRATOR_TOLERANCE
    chosen = [i for i, p in enumerate(poles) if p.imag >= 0.0]
    chosen.sort(key=lambda i: not at_one[i])
    m = len(chosen)
    aa, bb, cc = np.zeros((m, 2, 2)), np.zeros((m, 2)), np.zeros((m, 2))
    for k, i in enumerate(chosen):
        p, r = poles[i], residues[i]
        if p.imag > 0.0:
            aa[k] = [[0.0, 1.0], [-(abs(p) ** 2), 2.0 * p.real]]
            bb[k], cc[k] = [0.0, 1.0], [-2.0 * (r * p.conjugate()).real, 2.0 * r.real]
        else:
            aa[k, 0, 0], bb[k, 0], cc[k, 0] = (1.0 if at_one[i] else p.real), r.real, 1.0
    made = DiscreteFilter(aa, bb, cc, direct, float(rate_hz), 0 if at_one.any() else None)
    _require_same(made, states, into, out, direct)
    return made


def _require_same(made: DiscreteFilter, a: Array, b: Array, c: Array, d: float) -> None:
    """Raise ConfigError unless blocks and matrices answer alike at some points of the unit circle."""
    f = np.geomspace(1e-4, 0.49, 12) * made.rate_hz
    z = np.exp(2j * np.pi * f / made.rate_hz)
    wanted = np.array([(c @ np.linalg.solve(x * np.eye(a.shape[0]) - a, b))[0, 0] + d for x in z])
    error = float(np.max(np.abs(made.frequency_response(f) - wanted)) / (np.max(np.abs(wanted)) or 1.0))
    if not error < 1e-6:
        raise ConfigError(
            f"filter: its blocks answer differently by {error:.2g}, the limit is 1e-6: poles repeat; move them apart"
        )


def tustin_zpk(
    zeros_1_s: ArrayLike, poles_1_s: ArrayLike, gain: float, rate_hz: float
) -> tuple[ComplexArray, ComplexArray, float]:
    """Return zeros, poles and gain in z of a continuous filter by the bilinear rule, not prewarped.

    Zeros are (m,), poles (n,), in s⁻¹. The rule is s = 2 rate (z - 1)/(z + 1). Zeros at infinity land on z = -1. Raises
    ConfigError when the filter is improper.
    """
    zs, ps = np.asarray(zeros_1_s, dtype=complex), np.asarray(poles_1_s, dtype=complex)
    if zs.size > ps.size:
        raise ConfigError(f"filter: {zs.size} zeros over {ps.size} poles; add a low pass of order {zs.size - ps.size}")
    two_rate = 2.0 * rate_hz
    z_gain = gain
    # factor by factor, so that eighth powers of 20,000 never meet
    for i in range(ps.size):
        z_gain *= ((two_rate - zs[i]) if i < zs.size else 1.0) / (two_rate - ps[i])
    zeros = np.concatenate([(two_rate + zs) / (two_rate - zs), -np.ones(ps.size - zs.size)])
    poles = (two_rate + ps) / (two_rate - ps)
    return np.asarray(zeros, dtype=complex), np.asarray(poles, dtype=complex), float(np.real(z_gain))
