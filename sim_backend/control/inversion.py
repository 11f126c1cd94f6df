"""Inverting a response: the input of a periodic motion, and the filter by which repetitive control learns.

    u_k = Q (u_{k-N} + k_r z^lead L e_{k-N})      converges fastest where z^lead S_p L = 1

The input of a periodic motion is its Fourier series over the response, line by line, which no zero outside the unit
circle hinders. The learning filter has to run sample by sample: it is the sum of second-order blocks with chosen poles
whose numerators bring z^lead S_p L nearest to 1 in the sense of least squares. The lead allows for the non-causal part
of the inverse.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from sim_backend.control.blocks import DiscreteFilter
from sim_backend.control.realisation import realised
from sim_backend.errors import ConfigError
from sim_backend.linear import DiscreteModel, ModalModel, discretise

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

SPARE_POLES = tuple(0.6 * np.exp(1j * np.pi * angle) for angle in np.linspace(0.08, 0.92, 8))
"""Fast poles at all angles: blocks that ring for five samples form the non-causal part of the inverse."""

LEAK_HZ = 0.1
"""The feedback's integrator, of which the inverse has a copy, leaks by this: an input has no pole at rest to learn."""

_NEAR_ONE = 1e-6
_FAR_ZERO = 1e3
_SINGULAR = 1e-12


def periodic_input(plant: ModalModel, motion: ArrayLike, rate_hz: float) -> Array:
    """Return the input (n,) that holds `plant` (one input, one output) on the periodic `motion` (n,), samplewise.

    Raises ConfigError when the plant does not answer at a frequency of the motion.
    """
    wanted = np.asarray(motion, dtype=float)
    lines = np.fft.rfft(wanted)
    f = np.linspace(0.0, rate_hz * (lines.size - 1) / wanted.size, lines.size)
    answer = discretise(plant, rate_hz).frequency_response(f)[:, 0, 0]
    if not np.all(np.abs(answer) > 0.0):
        raise ConfigError(
            f"the plant does not answer at {f[np.argmin(np.abs(answer))]:g} Hz; no input holds it on this motion"
        )
    drive = lines / answer
    if wanted.size % 2 == 0:
        drive[-1] = drive[-1].real
    drive[0] = drive[0].real
    return np.fft.irfft(drive, wanted.size)


def advanced(periodic: ArrayLike, samples: float) -> Array:
    """Return one period (n,) as it is so many `samples` later, between samples by its Fourier series."""
    values = np.asarray(periodic, dtype=float)
    lines = np.fft.rfft(values) * np.exp(2j * np.pi * np.arange(values.size // 2 + 1) * samples / values.size)
    if values.size % 2 == 0:
        lines[-1] = lines[-1].real
    return np.fft.irfft(lines, values.size)


def siso_matrices(plant: DiscreteModel) -> tuple[Array, Array, Array]:
    """Return A (n, n), B (n, 1) and C (1, n) of a plant of one input and output, its delay included.

    Raises ConfigError for a direct feedthrough that acts within its own sample.
    """
    a, b, c, direct = realised(plant)
    if direct:
        raise ConfigError(
            f"feedthrough of {direct:.3g} within the sample; design needs a plant that answers a sample later: "
            "identify it with a delay"
        )
    return a, b, c


def transmission_zeros(plant: DiscreteModel) -> ComplexArray:
    """Return the finite zeros (n,) in z of a plant of one input and output; raises as `siso_matrices`."""
    a, b, c = siso_matrices(plant)
    n = a.shape[0]
    unit = np.zeros((n + 1, n + 1))
    unit[:n, :n] = np.eye(n)
    found = scipy.linalg.eigvals(np.block([[a, b], [c, np.zeros((1, 1))]]), unit)
    return np.asarray(found[np.isfinite(found) & (np.abs(found) < _FAR_ZERO)], dtype=complex)


def inverse_poles(plant: DiscreteModel, controller: DiscreteFilter) -> list[complex]:
    """Return poles in z, one of each pair, for the causal and stable part of (1 + P C)/P = 1/P + C.

    These are the plant's zeros within the unit circle, the controller's poles, with its integrator made to leak, and
    SPARE_POLES.
    """
    zeros = transmission_zeros(plant)
    own = controller.poles()
    own = own[(np.abs(own) > _NEAR_ONE) & (np.abs(own - 1.0) > _NEAR_ONE)]
    both = np.concatenate([zeros[np.abs(zeros) < 1.0 - _NEAR_ONE], own])
    upper = [complex(p) for p in both if p.imag > 1e-9]
    real = [complex(p.real) for p in both if abs(p.imag) <= 1e-9]
    leak = complex(np.exp(-2.0 * np.pi * LEAK_HZ / controller.rate_hz))
    return [*upper, *real, leak, *SPARE_POLES]


def fitted_inverse(
    frequency_hz: ArrayLike,
    process: ArrayLike,
    weight: ArrayLike,
    poles: list[complex],
    lead_samples: int,
    rate_hz: float,
) -> DiscreteFilter:
    """Return L with the given `poles` that brings z^lead · process · L nearest to 1, weighed, by least squares.

    `process` (n_f,), or (n, n_f) for n plants at once, is the sampled response from the learned input to the output,
    `weight` (n_f,). `poles` hold one of every conjugate pair. Raises ConfigError when a pole is not inside the unit
    circle, or the lead is negative.

    At one frequency the sum over plants of |p L - 1|² is |g L - Σp*/g|² and what no L changes, with g² = Σ|p|²: one
    row stands for all plants.
    """
    f, w = np.asarray(frequency_hz, dtype=float), np.asarray(weight, dtype=float)
    if lead_samples < 0 or not all(abs(p) < 1.0 for p in poles):
        raise ConfigError(
            f"learning filter: lead {lead_samples}, largest pole {max(map(abs, poles)):.4g} from zero; "
            "the lead must not be negative, every pole inside the unit circle"
        )
    z = np.exp(2j * np.pi * f / rate_hz)
    pairs = [abs(p.imag) > 0.0 for p in poles]
    columns = [np.ones_like(z)]
    for p, paired in zip(poles, pairs, strict=True):
        if paired:
            below = z**2 - 2.0 * p.real * z + abs(p) ** 2
            columns += [1.0 / below, z / below]
        else:
            columns.append(1.0 / (z - p.real))
    plants = np.atleast_2d(np.asarray(process, dtype=complex))
    strength = np.linalg.norm(plants, axis=0)
    answers = strength > 0.0
    wanted = np.divide(w * plants.sum(axis=0).conj(), strength, out=np.zeros_like(z), where=answers)
    # the lead turns both sides of a row; here it turns the wanted one
    wanted *= z ** (-lead_samples)
    design = (w * strength)[:, None] * np.stack(columns, axis=1)
    size = np.linalg.norm(design, axis=0)
    size[size == 0.0] = 1.0
    stacked = np.vstack([(design / size).real, (design / size).imag])
    found = np.linalg.lstsq(stacked, np.concatenate([wanted.real, wanted.imag]), rcond=_SINGULAR)[0] / size
    return _filter(poles, pairs, found, rate_hz)


def _filter(poles: list[complex], pairs: list[bool], found: Array, rate_hz: float) -> DiscreteFilter:
    m, k = len(poles), 1
    a, b, c = np.zeros((m, 2, 2)), np.zeros((m, 2)), np.zeros((m, 2))
    for i, (p, paired) in enumerate(zip(poles, pairs, strict=True)):
        if paired:
            a[i], b[i] = [[0.0, 1.0], [-(abs(p) ** 2), 2.0 * p.real]], [0.0, 1.0]
            c[i] = found[k : k + 2]
            k += 2
        else:
            a[i, 0, 0], b[i, 0], c[i, 0] = p.real, 1.0, found[k]
            k += 1
    return DiscreteFilter(a, b, c, float(found[0]), float(rate_hz))
