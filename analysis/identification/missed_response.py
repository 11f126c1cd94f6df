"""Where a fitted model misses what the measured response shows, in words: for every kind of fit to a response."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.frequency.frf import smoothed
from analysis.identification.line_fit import POOLED_LINES
from analysis.identification.modelled_response import response_of
from analysis.identification.response_curves import ResponseCurve
from sim_backend.linear import Array, ComplexArray
from sim_backend.model import Model

MISSED = 0.1
"""Part of the response that a model may miss at a line without a remark."""

CLEAR = 5.0
"""Standard deviations that a miss must exceed: of complex Gaussian noise one line in 10^10 does."""


@dataclass(frozen=True)
class Miss:
    """A line at which a model misses a response, by which part of the larger of the two."""

    frequency_hz: float
    part: float


def worst_miss(frequency_hz: Array, response: ComplexArray, modelled: ComplexArray, variance: Array) -> Miss | None:
    """Return the worst miss of a response (n_f,) that is much and not noise, None without any.

    `variance` (n_f,) is E|error|² of the response. Worst is a large part of a large response: beyond all resonances a
    model may be off by a factor, which matters less than a resonance that it lacks.
    """
    missed, size = np.abs(modelled - response), np.maximum(np.abs(response), np.abs(modelled))
    part = np.divide(missed, size, out=np.zeros_like(missed), where=missed > CLEAR * np.sqrt(variance))
    k = int(np.argmax(np.where(part > MISSED, part * missed, 0.0)))
    return Miss(float(frequency_hz[k]), float(part[k])) if part[k] > MISSED else None


def remarks_on_misses(
    curves: Sequence[ResponseCurve], modelled: Callable[[ResponseCurve], ComplexArray]
) -> tuple[str, ...]:
    """Return in words the worst miss of all curves by the response `modelled` (n_f,) of each, none where none is."""
    found = []
    for curve in curves:
        response = curve.magnitude * np.exp(1j * curve.phase_rad)
        model = modelled(curve)
        miss = worst_miss(curve.frequency_hz, response, model, _variance(curve, model - response))
        if miss is not None:
            found.append((miss.part, miss.frequency_hz, curve))
    if not found:
        return ()
    part, f, curve = max(found, key=lambda one: one[0])
    others = f" (and more than {100.0 * MISSED:g} % of {len(found) - 1} other responses)" if len(found) > 1 else ""
    return (
        f"the model misses the response {curve.input} → {curve.output} at {f:.4g} Hz by {100.0 * part:.3g} %, far more "
        f"than its noise{others}: give --modes for more, or expect a bench that is not linear there",
    )


def response_of_model(model: Model) -> Callable[[ResponseCurve], ComplexArray]:
    """Return what gives the response (n_f,) of a model at the lines of a curve, between samples as it is simulated."""
    inputs, outputs = ([port.name for port in ports] for ports in (model.inputs, model.outputs))

    def modelled(curve: ResponseCurve) -> ComplexArray:
        return response_of(model, curve.frequency_hz)[:, outputs.index(curve.output), inputs.index(curve.input)]

    return modelled


def _variance(curve: ResponseCurve, missed: ComplexArray) -> Array:
    """Return E|error|² (n_f,) of a response, pooled over neighbouring lines; by what is rough where it is unknown."""
    if np.isfinite(curve.std).all():
        own = 2.0 * curve.std**2
        # a line's own has few degrees of freedom, and its neighbours may have been driven more
        return np.asarray(np.maximum(own, smoothed(own, POOLED_LINES)))
    return _roughness(missed)


def _roughness(missed: NDArray[np.complex128]) -> Array:
    """Return E|error|² (n_f,) by second differences of a misfit, which is smooth but for noise.

    A median over neighbours, so that a resonance that is missed on a few lines does not count as noise.
    """
    # the weights 1, -2, 1 have a sum of squares of six; of |error|², exponential, the median is ln 2
    rough = np.abs(np.diff(missed, 2)) ** 2 / 6.0 / np.log(2.0)
    n = missed.size
    middle = np.arange(n) - 1
    return np.array(
        [np.median(rough[max(k - POOLED_LINES, 0) : max(k + POOLED_LINES + 1, 1)]) for k in middle.tolist()]
    )
