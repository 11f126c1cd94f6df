"""A plant as matrices: its blocks behind the register of past inputs that its delay is made of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_backend.linear import DiscreteModel, delay_taps

Array = NDArray[np.float64]

_NO_WEIGHT = 1e-9
"""Weight of a past input that is rounding: a time times a rate is whole but for it."""


def realised(plant: DiscreteModel, output: int = 0, input_: int = 0) -> tuple[Array, Array, Array, float]:
    """Return A (n, n), B (n, 1), C (1, n) and D from one input to one output of a plant, its delay included.

    The delayed input is the weighted sum of past ones that also the response is made of
    (`sim_backend.linear.delay_taps`).
    """
    taps = delay_taps(float(plant.delay_samples[input_]))
    weights = np.concatenate([np.zeros(taps.first), taps.weights])
    weights = weights[: int(np.flatnonzero(np.abs(weights) > _NO_WEIGHT)[-1]) + 1]
    m, n_past = plant.a.shape[0], weights.size - 1
    n = 2 * m + n_past
    a, b, c = np.zeros((n, n)), np.zeros((n, 1)), np.zeros((1, n))
    for i in range(m):
        a[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = plant.a[i]
    entry, direct = plant.b[:, :, input_].reshape(-1), float(plant.d[output, input_])
    c[0, : 2 * m], c[0, 2 * m :] = plant.c[output].reshape(-1), direct * weights[1:]
    a[: 2 * m, 2 * m :] = entry[:, None] * weights[1:]
    b[: 2 * m, 0] = entry * weights[0]
    if n_past:  # the newest past input first
        b[2 * m, 0] = 1.0
        a[range(2 * m + 1, n), range(2 * m, n - 1)] = 1.0
    return a, b, c, direct * float(weights[0])
