"""A modal model as a transfer function: the coefficients that Table 6.2 of the paper prints."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_backend.linear import ModalModel

Array = NDArray[np.float64]


def polynomials(model: ModalModel, output: int = 0, input_: int = 0) -> tuple[Array, Array]:
    """Return numerator (2m + 1,) and monic denominator (2m + 1,) from the lowest power up; (6.3) of the paper.

    For display only: simulating such polynomials loses all digits. The delay is left out.
    """
    factors = [np.array([w**2, 2.0 * s, 1.0]) for w, s in zip(model.omega_rad_s, model.sigma_1_s, strict=True)]
    denominator = _product(factors)
    numerator = np.zeros(denominator.size) + model.d[output, input_] * denominator
    for i, (w2, two_s, _) in enumerate(factors):
        b, direct = model.b[i, input_], model.b_direct[i, input_]
        c, rate = model.c[output, i], model.c_rate[output, i]
        # q = ((s + 2 sigma) direct + b)/den, v = (s b - omega² direct)/den
        own = np.array([c * (two_s * direct + b) - rate * w2 * direct, c * direct + rate * b])
        term = np.convolve(own, _product([f for j, f in enumerate(factors) if j != i]))
        numerator[: term.size] += term
    return numerator, denominator


def _product(factors: list[Array]) -> Array:
    out = np.ones(1)
    for factor in factors:
        out = np.convolve(out, factor)
    return out
