"""Transfer functions given as polynomials, taken apart into second-order blocks.

An eighth-order plant in SI has coefficients from 1 to 1e27. Its roots are found in a scaled frequency, s = w
p with w the geometric mean of the roots' moduli, where the coefficients are of comparable size; the residues
follow from the roots as products of differences, so no large polynomial is ever evaluated.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


def scaled_roots(coefficients: ArrayLike) -> ComplexArray:
    """Return the roots, shape (n,), of a polynomial given from the highest power down, scaled first.

    Raises ConfigError when the first coefficient is zero or one is not finite.
    """
    c = np.atleast_1d(np.asarray(coefficients, dtype=float))
    if c.size == 0 or not np.all(np.isfinite(c)) or c[0] == 0.0:
        raise ConfigError(
            f"polynomial {c.tolist()} has no finite leading coefficient; give it from the highest power down"
        )
    n = c.size - 1
    if n == 0:
        return np.empty(0, dtype=complex)
    scale = abs(c[-1] / c[0]) ** (1.0 / n) if c[-1] != 0.0 else 1.0
    monic = c / c[0] / scale ** np.arange(n + 1)
    return np.asarray(np.roots(monic) * scale, dtype=complex)


def real_pairs(roots: ArrayLike, alone: tuple[complex, ...] = ()) -> list[tuple[complex, complex | None]]:
    """Return roots as conjugate pairs, pairs of neighbouring real roots and at most one single.

    `roots` are (n,). Every root in `alone` is taken out first and stands by itself. Real roots are paired nearest
    first, so a double root shares one pair. Raises ConfigError when a complex root lacks its conjugate.
    """
    left = list(np.asarray(roots, dtype=complex))
    pairs: list[tuple[complex, complex | None]] = []
    for root in alone:
        nearest = int(np.argmin([abs(r - root) for r in left]))
        pairs.append((complex(left.pop(nearest)), None))
    # a pair of roots that numerical noise split off the axis by this much is still real for the purposes here
    real = sorted((r.real for r in left if abs(r.imag) <= 1e-12 * abs(r)), reverse=True)
    upper = [r for r in left if r.imag > 1e-12 * abs(r)]
    lower = [r for r in left if r.imag < -1e-12 * abs(r)]
    if len(upper) != len(lower):
        raise ConfigError(f"{len(upper)} roots above and {len(lower)} below the real axis; give conjugates too")
    pairs += [(complex(r), complex(r).conjugate()) for r in upper]
    while len(real) > 1:
        k = int(np.argmin(-np.diff(real)))
        pairs.append((complex(real.pop(k)), complex(real.pop(k))))
    pairs += [(complex(root), None) for root in real]
    return pairs


def block_numerator(
    pair: tuple[complex, complex | None], zeros: ArrayLike, other_poles: ArrayLike, gain: float
) -> tuple[float, float]:
    """Return (n1, n0) of the term (n1 x + n0)/((x - p1)(x - p2)) of a partial fraction sum.

    It is the straight line through F(x) = gain Π(x - zeros) / Π(x - other poles) at both poles (for a single
    pole the constant F(p), returned as (0, F)); a double pole takes the tangent. Conjugate, distinct real and
    double poles are therefore one case. Raises ConfigError when a pole appears in more than one pair.
    """
    z, o = np.asarray(zeros, dtype=complex), np.asarray(other_poles, dtype=complex)

    def rest(x: complex) -> complex:
        if np.any(x == o):
            raise ConfigError(f"pole {x} appears in two second-order blocks, which cannot hold it; spread the poles")
        # factors are taken in turn, so that neither product leaves the range of numbers
        value = complex(gain)
        for i in range(max(z.size, o.size)):
            value *= (x - z[i]) if i < z.size else 1.0
            value /= (x - o[i]) if i < o.size else 1.0
        return value

    p1, p2 = pair
    if p2 is None:
        return 0.0, rest(p1).real
    if abs(p1 - p2) > 1e-6 * abs(p1):
        slope = (rest(p1) - rest(p2)) / (p1 - p2)
    else:
        middle = 0.5 * (p1 + p2)
        slope = rest(middle) * (np.sum(1.0 / (middle - z)) - np.sum(1.0 / (middle - o)))
    return slope.real, (rest(p1) - slope * p1).real


def modal_from_zpk(zeros_1_s: ArrayLike, poles_1_s: ArrayLike, gain: float) -> ModalModel:
    """Return gain Π(s - zeros) / Π(s - poles) as a ModalModel, modes by rising frequency.

    Zeros are (m,), poles (n,), in s⁻¹. The gain is in output units per input unit times (s⁻¹)^(poles - zeros). Each
    block gets `b` = 1, `c` and `c_rate` from the partial fraction (n1 s + n0)/(s² + 2 sigma s + omega²), v being dq/dt.
    Raises ConfigError when the fraction is improper, the poles are not conjugate or their number is odd.
    """
    zeros, poles = np.asarray(zeros_1_s, dtype=complex), np.asarray(poles_1_s, dtype=complex)
    if zeros.size > poles.size:
        raise ConfigError(f"{zeros.size} zeros over {poles.size} poles is improper; leave out a zero or add a pole")
    pairs = real_pairs(poles)
    if any(p2 is None for _, p2 in pairs):
        raise ConfigError(
            f"{poles.size} poles: a sum of second-order blocks needs an even number; add a fast real pole"
        )
    rows = []
    for i, (p1, p2) in enumerate(pairs):
        assert p2 is not None
        others = [p for j, both in enumerate(pairs) if j != i for p in both if p is not None]
        n1, n0 = block_numerator((p1, p2), zeros, others, gain)
        rows.append((np.sqrt(abs((p1 * p2).real)), -0.5 * (p1 + p2).real, n0, n1))
    omega, sigma, n0s, n1s = np.array(sorted(rows)).T
    m = omega.size
    return ModalModel(
        omega_rad_s=omega,
        sigma_1_s=sigma,
        b=np.ones((m, 1)),
        b_direct=np.zeros((m, 1)),
        c=n0s[None, :],
        c_rate=n1s[None, :],
        d=np.array([[gain if zeros.size == poles.size else 0.0]]),
        delay_s=np.zeros(1),
    )


def modal_from_polynomial(numerator: ArrayLike, denominator: ArrayLike, output_scale: float = 1.0) -> ModalModel:
    """Return numerator(s)/denominator(s), highest power first, as a ModalModel.

    Coefficients are (m,) and (n,). `output_scale` turns the output into SI. Example: Table 6.2 gives mrad per N m, so
    `output_scale` is 1e-3. Raises ConfigError as `modal_from_zpk` does.
    """
    num, den = (
        np.atleast_1d(np.asarray(numerator, dtype=float)),
        np.atleast_1d(np.asarray(denominator, dtype=float)),
    )
    return modal_from_zpk(scaled_roots(num), scaled_roots(den), output_scale * float(num[0] / den[0]))
