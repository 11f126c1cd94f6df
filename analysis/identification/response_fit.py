"""Weighted least squares between a ModalModel and a frequency response: normal equations and their minimum."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from analysis.identification.block_basis import block_matrices, block_spectra
from analysis.identification.dropped import Dropped
from analysis.identification.modal_parameters import (
    Layout,
    Structure,
    determined,
    layout_of,
    pack,
    participation,
    step_limit,
    unpack,
)
from analysis.identification.normal_equations import Normal, covariance, minimise
from analysis.identification.response_equations import summed
from analysis.linear.modal_form import canonical
from sim_backend.errors import ConfigError, DataError
from sim_backend.linear import Array, ModalModel, delay_taps

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True)
class Target:
    """What a fit has to meet: frequency (n_f,), response and weight (n_f, n_y, n_u), and how it was measured.

    The weight is 1 ÷ standard deviation of the real part (of the magnitude, for a magnitude-only fit).
    """

    frequency_hz: Array
    response: ComplexArray
    weight: Array
    hold_rate_hz: float | None
    magnitude_only: bool

    @cached_property
    def point(self) -> ComplexArray:
        """The points lambda (n_f,) at which blocks are resolved: s, or z behind a hold."""
        s = 2j * np.pi * self.frequency_hz
        return np.asarray(s if self.hold_rate_hz is None else np.exp(s / self.hold_rate_hz), dtype=np.complex128)


@dataclass(frozen=True)
class RationalFit:
    """A fitted model with its uncertainty.

    `covariance` (p, p) belongs to the vector of `modal_parameters.pack(model)`; `omega_std_rad_s` and `sigma_std_1_s`
    (m,) are drawn from it. `chi2` is the weighted sum of squares, `dof` its degrees of freedom; `scaled` is True when
    no variance was given, and the covariance was scaled so that chi2 = dof. `criterion` is the Bayesian information
    criterion, `orders` the numbers of blocks tried with their criteria, `dropped` the modes that were
    given up.
    """

    model: ModalModel
    layout: Layout
    covariance: Array
    omega_std_rad_s: Array
    sigma_std_1_s: Array
    chi2: float
    dof: int
    scaled: bool
    criterion: float
    converged: bool
    orders: tuple[tuple[int, float], ...]
    dropped: tuple[Dropped, ...] = ()


def make_target(
    frequency_hz: Array,
    response: ComplexArray,
    variance: Array | None,
    hold_rate_hz: float | None,
    magnitude_only: bool = False,
) -> Target:
    """Return the target of a fit, checked, with weights from `variance`.

    `frequency_hz` is (n_f,), `response` and `variance` (n_f, n_y, n_u) in output units per input unit (squared).
    Raises ConfigError for other shapes or frequencies above half the hold rate, DataError for fewer than four lines,
    lines that do not ascend, numbers that are not finite, or a variance of another shape or not positive.
    """
    # copies, so that compiled code sees one kind of array only: its own, in the order of rows
    f, g = np.array(frequency_hz, dtype=float, order="C"), np.array(response, dtype=complex, order="C")
    if g.ndim != 3 or g.shape[0] != f.size:
        raise ConfigError(
            f"response has shape {g.shape}, frequency has {f.size}; needs (n_f, n_y, n_u) with one row per frequency"
        )
    if f.size < 4 or np.any(np.diff(f) <= 0.0) or f[0] < 0.0:
        raise DataError(f"frequency response has {f.size} lines; a fit needs at least 4, positive and rising")
    if hold_rate_hz is not None and not f[-1] <= 0.5 * hold_rate_hz:
        raise ConfigError(
            f"highest frequency is {f[-1]} Hz, above half the hold rate {hold_rate_hz} Hz; cut the band or mend it"
        )
    if not np.all(np.isfinite(g)):
        raise DataError("frequency response holds a number that is not finite; leave out the lines without excitation")
    if variance is None:
        weight = np.full(g.shape, 1.0 / np.sqrt(np.mean(np.abs(g) ** 2)))
    else:
        if np.shape(variance) != g.shape or not np.all(np.asarray(variance) > 0.0):
            raise DataError(
                f"variance must be positive with shape {g.shape}; give one for every entry of the response, or none"
            )
        # half of E|error|^2 falls to the real part and half to the imaginary part, and along the magnitude too
        weight = np.sqrt(2.0 / np.array(variance, dtype=float, order="C"))
    return Target(f, g, weight, hold_rate_hz, magnitude_only)


def refine(
    target: Target, start: ModalModel, structure: Structure, scaled: bool = False, iterations: int = 200
) -> RationalFit:
    """Return the weighted least-squares fit reached from `start` by Levenberg-Marquardt with an analytic Jacobian."""
    layout = layout_of(start, structure)
    fixed = pack(start)
    free = np.flatnonzero(layout.free)
    inside = free[:, None] * layout.size + free  # one by one in a row, which is three times as fast as by two indices
    delay = None if structure.delay else _delay_factor(start.delay_s, target)
    latest: tuple[Array, Normal] | None = None

    def assemble(x: Array) -> Normal:
        nonlocal latest
        if latest is None or latest[0] is not x:  # what a step has tried it takes
            vector = fixed.copy()
            vector[free] = x
            normal = _summed(target, vector, layout, delay)
            latest = x, Normal(normal.cost, normal.gradient[free], normal.hessian.take(inside))
        return latest[1]

    def cost(x: Array) -> float:
        # most steps are taken, and the Jacobian then costs little more than the response alone
        return assemble(x).cost

    minimum = minimise(assemble, cost, fixed[free], iterations, limit=step_limit(layout))
    found = fixed.copy()
    found[free] = minimum.parameters
    model = canonical(unpack(found, layout))
    return _result(target, model, normal_equations(target, model, layout, delay), layout, scaled, minimum.converged)


def _result(
    target: Target, model: ModalModel, normal: Normal, layout: Layout, scaled: bool, converged: bool
) -> RationalFit:
    """Return the result with the covariance of the canonical model, whose equations are given, and the criterion."""
    free = np.flatnonzero(determined(model, layout))
    inside = free[:, None], free
    small = covariance(Normal(normal.cost, normal.gradient[free], normal.hessian[inside]))
    values = target.response.size * (1 if target.magnitude_only else 2)
    count = free.size
    dof = max(values - count, 1)
    factor = normal.cost / dof if scaled else 1.0
    full = np.zeros((layout.size, layout.size))
    full[inside] = small * factor
    std = np.sqrt(np.maximum(np.diag(full), 0.0))
    fit = values * np.log(normal.cost / values) if scaled else normal.cost
    return RationalFit(
        model,
        layout,
        full,
        model.omega_rad_s * std[layout.index("log_omega")],
        model.sigma_1_s * std[layout.index("log_sigma")],
        normal.cost,
        dof,
        scaled,
        float(fit + count * np.log(values)),
        converged,
        ((model.n_blocks, float(fit + count * np.log(values))),),
    )


def _residual(target: Target, response: ComplexArray) -> Array | ComplexArray:
    """Return the weighted residual (model minus data), complex, or real for a magnitude-only fit."""
    if target.magnitude_only:
        return target.weight * (np.abs(response) - np.abs(target.response))
    return target.weight * (response - target.response)


def residual_cost(target: Target, model: ModalModel) -> float:
    """Return the weighted sum of squares of the difference between model and data."""
    return float(np.sum(np.abs(_residual(target, model_response(model, target))) ** 2))


def model_response(model: ModalModel, target: Target) -> ComplexArray:
    """Return the response (n_f, n_y, n_u) of a model as the target was measured."""
    (q, v), part = block_states(model, target), participation(model)
    response = np.tensordot(q, part.n0, axes=(0, 0)) + np.tensordot(v, part.n1, axes=(0, 0)) + model.d
    return response * _delay_factor(model.delay_s, target)[0][:, None, :]


def block_states(model: ModalModel, target: Target) -> ComplexArray:
    """Return (q, v) of every block under a unit force at the target's frequencies, shape (2, m, n_f)."""
    blocks = block_matrices(model.omega_rad_s, model.sigma_1_s, target.hold_rate_hz)
    return block_spectra(blocks, target.point)[0]


def _delay_factor(delay_s: Array, target: Target) -> tuple[ComplexArray, ComplexArray]:
    """Return the delay's factor and its derivative to the delay, each (n_f, n_u).

    Behind a hold a part of a sample is interpolated, for one factor has to do for all modes. Fits in time go on from
    there, and are exact.
    """
    s = 2j * np.pi * target.frequency_hz[:, None]
    if target.hold_rate_hz is None:
        factor = np.exp(-s * delay_s)
        return factor, -s * factor
    factor, slope = np.empty((2, s.size, delay_s.size), dtype=complex)
    back = np.exp(-s[:, 0] / target.hold_rate_hz)
    for u, late_s in enumerate(delay_s):
        taps = delay_taps(float(late_s * target.hold_rate_hz))
        factor[:, u] = back**taps.first * np.polyval(taps.weights[::-1], back)
        slope[:, u] = target.hold_rate_hz * back**taps.first * np.polyval(taps.slopes[::-1], back)
    return factor, slope


def normal_equations(
    target: Target, model: ModalModel, layout: Layout, delay: tuple[ComplexArray, ComplexArray] | None = None
) -> Normal:
    """Return cost, J'r (p,) and J'J (p, p) over all parameters of the layout; `delay` as for `_summed`.

    The entry (y, u) of the response sees only its own output's and input's participation, so J'J is summed from the
    small one of each entry.
    """
    return _summed(target, pack(model), layout, delay)


def _summed(
    target: Target, vector: Array, layout: Layout, delay: tuple[ComplexArray, ComplexArray] | None = None
) -> Normal:
    """Return the normal equations at a parameter vector; `delay` is what `_delay_factor` returns, if it is known."""
    if delay is None:
        delay = _delay_factor(np.maximum(vector[layout.span("delay_s")], 0.0), target)
    held = None
    if target.hold_rate_hz is not None:
        omega, sigma = np.exp(vector[layout.span("log_omega")]), np.exp(vector[layout.span("log_sigma")])
        blocks = block_matrices(omega, sigma, target.hold_rate_hz)
        a, b, da, db = (np.ascontiguousarray(matrix) for matrix in (blocks.a, blocks.b, blocks.da, blocks.db))
        held = a, b, da, db
    sizes = layout.n_blocks, layout.n_inputs, layout.n_outputs
    measured = (target.weight, target.response, target.magnitude_only)
    return Normal(*summed(vector, sizes, held, target.point, delay, *measured, layout.entries))
