"""Fit of a sum of modes to the magnitude of a frequency response alone, as from a sweep without phase."""

from __future__ import annotations

from itertools import product

import numpy as np
import scipy

from analysis.identification.modal_parameters import Structure
from analysis.identification.response_fit import RationalFit, Target, make_target, refine
from sim_backend.errors import ConfigError
from sim_backend.linear import Array, ModalModel

# every further mode doubles the sign patterns to try
_MOST_BLOCKS = 8


def fit_magnitude(
    frequency_hz: Array,
    magnitude: Array,
    blocks: int,
    *,
    std: Array | None = None,
    hold_rate_hz: float | None = None,
    iterations: int = 200,
) -> RationalFit:
    """Return sum over modes of K / (s² + 2 sigma s + omega²), K of either sign, that fits a magnitude best.

    Shapes: `frequency_hz`, `magnitude` and its standard deviation `std` (n_f,); without `std`, equal relative weights.
    One input and one output. The magnitude does not tell the sign of the whole response: the lowest mode's K is taken
    positive. Every pattern of the other signs is tried, for an antiresonance between two modes is the only trace that
    their signs leave. Raises ConfigError or DataError when the data do not fit together.
    """
    size = np.asarray(magnitude, dtype=float)
    if size.ndim != 1 or np.any(size <= 0.0):
        raise ConfigError(
            f"magnitude has shape {size.shape}; needs positive numbers, one per frequency of one input and output"
        )
    if not 1 <= blocks <= _MOST_BLOCKS:
        raise ConfigError(f"blocks is {blocks}; a magnitude fit takes 1 to {_MOST_BLOCKS}")
    deviation = size if std is None else np.asarray(std, dtype=float)
    # the real part and the magnitude carry half of E|error|^2 each
    variance = (2.0 * deviation**2)[:, None, None]
    target = make_target(frequency_hz, size[:, None, None], variance, hold_rate_hz, magnitude_only=True)
    structure = Structure("mechanical", feedthrough=False)
    omega, sigma = _peaks(target, blocks)
    peak = np.interp(omega / (2.0 * np.pi), target.frequency_hz, size)
    best: RationalFit | None = None
    for signs in product([1.0, -1.0], repeat=blocks - 1):
        gain = peak * 2.0 * sigma * omega * np.array([1.0, *signs])
        start = ModalModel(
            omega,
            sigma,
            np.ones((blocks, 1)),
            np.zeros((blocks, 1)),
            gain[None],
            np.zeros((1, blocks)),
            np.zeros((1, 1)),
            np.zeros(1),
        )
        fit = refine(target, start, structure, std is None, max(iterations // 5, 20))
        best = fit if best is None or fit.chi2 < best.chi2 else best
    assert best is not None
    return _positive(refine(target, best.model, structure, std is None, iterations))


def _peaks(target: Target, blocks: int) -> tuple[Array, Array]:
    """Return starts for omega and sigma: the most prominent peaks, else spread over the decades of the band."""
    f, level = target.frequency_hz, np.log(np.abs(target.response[:, 0, 0]))
    found, facts = scipy.signal.find_peaks(level, prominence=0.0)
    best = found[np.argsort(facts["prominences"])[::-1][:blocks]]
    low = f[f > 0.0][0]
    spare = np.geomspace(low, f[-1], blocks - best.size + 2)[1:-1]
    centre = np.concatenate([f[best], spare])
    # half-power width: the magnitude falls by sqrt(2) at omega ± sigma
    width = []
    for k in best:
        above = np.abs(target.response[:, 0, 0]) > np.abs(target.response[k, 0, 0]) / np.sqrt(2.0)
        left, right = k, k
        while left > 0 and above[left - 1]:
            left -= 1
        while right < f.size - 1 and above[right + 1]:
            right += 1
        width.append(max(f[right] - f[left], 1e-3 * f[k]))
    sigma = np.concatenate([np.array(width) / 2.0, 0.1 * spare])
    order = np.argsort(centre)
    return 2.0 * np.pi * centre[order], 2.0 * np.pi * sigma[order]


def _positive(fit: RationalFit) -> RationalFit:
    """Return the fit with the whole response's sign such that the lowest mode's K is positive."""
    lowest = int(np.argmin(fit.model.omega_rad_s))
    sign = float(np.sign(fit.model.c[0, lowest] * fit.model.b[lowest, 0]))
    flipped = fit.model.with_(c=fit.model.c * sign)
    turn = np.ones(fit.layout.size)
    turn[fit.layout.index("c")] = sign
    return RationalFit(**{**fit.__dict__, "model": flipped, "covariance": fit.covariance * np.outer(turn, turn)})
