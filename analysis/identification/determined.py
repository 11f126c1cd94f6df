"""Modes that the data determine: a criterion that knows only noise finds modes in whatever no linear model explains."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from typing import TypeVar

import numpy as np

from analysis.identification.dropped import UNDETERMINED, Dropped
from analysis.identification.modal_parameters import participation
from analysis.identification.response_fit import RationalFit
from analysis.identification.timefit import TimeFit
from sim_backend.linear import Array, ComplexArray, ModalModel

_AnyFit = TypeVar("_AnyFit", TimeFit, RationalFit)

SIGNIFICANT = 3.0
"""Standard deviations by which a mode must differ from one that is not there."""


LEAVES = 2.0
"""Growth of the residual power up to which a mode is given up: of the noise-like errors of a nonlinear bench, one mode
never explains half."""


_MEETING, _APART = 0.1, (10.0, 30.0)
"""Difference of the damping ratio from one below which two poles meet, and ratios at which they begin anew."""


ALIKE = 0.5
"""Cosine between the residues of two modes in one place from which on they may be one: of two axes it is near zero."""


def determinedness(fit: TimeFit | RationalFit) -> Array:
    """Return by how many standard deviations each block differs from one that is not there, (m,).

    An oscillation has a frequency and a decay rate; the lesser counts. A rigid body has neither, and is there or not by
    the criterion.
    """
    model = fit.model
    frequency = _ratio(model.omega_rad_s, fit.omega_std_rad_s)
    decay = _ratio(model.sigma_1_s, fit.sigma_std_1_s)
    both = np.where(model.omega_rad_s > 0.0, np.minimum(frequency, decay), np.inf)
    return np.maximum(both, _pole_known(fit))


def _pole_known(fit: TimeFit | RationalFit) -> Array:
    """Return by how many standard deviations the better known pole of each overdamped block differs from zero, (m,).

    A braked rigid body has one pole at rest, a lag one that a zero cancels: neither is known, and frequency and decay
    rate, which are made of both poles, are not known for it. Zero for a block that swings.
    """
    model, known = fit.model, np.zeros(fit.model.n_blocks)
    places = np.stack([fit.layout.index("log_omega"), fit.layout.index("log_sigma")], axis=1)
    for i in np.flatnonzero((model.sigma_1_s > model.omega_rad_s) & (model.omega_rad_s > 0.0)):
        omega, sigma = model.omega_rad_s[i], model.sigma_1_s[i]
        root = np.sqrt(sigma**2 - omega**2)
        spread = fit.covariance[np.ix_(places[i], places[i])]
        # d ln p / d (ln omega, ln sigma) of p = sigma - root and sigma + root, whose product is omega²
        slopes = np.array([[sigma + root, -sigma], [root - sigma, sigma]]) / root
        relative = np.sqrt(np.maximum(np.einsum("pi,ij,pj->p", slopes, spread, slopes), 0.0))
        known[i] = np.max(_ratio(np.ones(2), relative))
    return known


def _ratio(value: Array, std: Array) -> Array:
    """Return `value` over `std`: infinite for what is known exactly, zero where a deviation could not be had."""
    known = np.divide(value, std, out=np.zeros_like(value), where=std > 0.0)
    return np.where(std == 0.0, np.inf, known)


def swinging(fit: TimeFit | RationalFit) -> Array:
    """Return `determinedness` (m,) of the blocks of a free axis: infinite for the slowest, zero for overdamped ones.

    The slowest block is the axis itself, which is certain. Flexible modes beside it oscillate; a slow block that does
    not stands for something nonlinear.
    """
    own = int(np.argmin(np.min(np.abs(fit.model.poles_1_s()), axis=1)))
    known = np.where(fit.model.sigma_1_s < fit.model.omega_rad_s, determinedness(fit), 0.0)
    known[own] = np.inf
    return known


def without_undetermined(
    fit: _AnyFit,
    orders: tuple[int, ...],
    again: Callable[[int, ModalModel | None], _AnyFit],
    measure: Callable[[TimeFit | RationalFit], Array] = determinedness,
    *,
    anew: bool = True,
) -> _AnyFit:
    """Return the fit with no mode that the data leave undetermined, fitted `again` with one fewer each time.

    A fit with one fewer may start from the remaining modes of the last one: a new start may miss a mode that the larger
    number had found, because its method puts a pole where nothing was played. The one with fewer undetermined modes
    counts, of equal ones the better: a spurious mode may gain more than a real one, and would be the next to be given
    up. `measure` returns by how many standard deviations each block is known (m,). Without `anew` every fit starts from
    the last one alone. What was given up is added to the `dropped` of the fit.
    """
    dropped = list(fit.dropped)

    def worth(one: _AnyFit) -> tuple[int, float]:
        return int(np.sum(measure(one) < SIGNIFICANT)), one.criterion

    while fit.model.n_blocks > orders[0] and np.min(known := measure(fit)) < SIGNIFICANT:
        i = int(np.argmin(known))
        if (apart := _apart(fit, i, again, measure)) is not None:
            fit = apart
            continue
        rest = fit.model.only(np.arange(known.size) != i)
        fewer = min((again(rest.n_blocks, start) for start in ([None, rest] if anew else [rest])), key=worth)
        if _needed(fit, fewer):
            break
        dropped.append(dropped_from(fit, i, fewer, UNDETERMINED))
        fit = fewer
    return replace(fit, dropped=tuple(dropped))


def _apart(
    fit: _AnyFit,
    i: int,
    again: Callable[[int, ModalModel | None], _AnyFit],
    measure: Callable[[TimeFit | RationalFit], Array],
) -> _AnyFit | None:
    """Return a fit as good in which block `i` is a lag that is known, None where it is not a lag or there is none.

    A lag is one pole of a block, a zero cancels the other one wherever that lies. Where both meet, neither is known.
    """
    omega, sigma = fit.model.omega_rad_s.copy(), fit.model.sigma_1_s.copy()
    if not abs(sigma[i] - omega[i]) < _MEETING * omega[i]:
        return None
    pole = sigma[i] - np.sqrt(max(sigma[i] ** 2 - omega[i] ** 2, 0.0))
    fits = []
    for times in _APART:
        omega[i], sigma[i] = pole * np.sqrt(times), 0.5 * pole * (1.0 + times)
        fits.append(again(omega.size, fit.model.with_(omega_rad_s=omega, sigma_1_s=sigma)))
    best = min(fits, key=lambda one: (int(np.sum(measure(one) < SIGNIFICANT)), one.criterion))
    fewer = np.sum(measure(best) < SIGNIFICANT) < np.sum(measure(fit) < SIGNIFICANT)
    return best if fewer and best.criterion < fit.criterion + np.log(fit.dof) else None


def dropped_from(fit: _AnyFit, i: int, fewer: _AnyFit | None, why: str) -> Dropped:
    """Return block `i` of a fit, which is not in `fewer`, as a dropped mode (None: what it explained is unknown)."""
    per_hz = 1.0 / (2.0 * np.pi)
    return Dropped(
        float(fit.model.omega_rad_s[i] * per_hz),
        float(fit.omega_std_rad_s[i] * per_hz),
        float(fit.model.sigma_1_s[i]),
        float(fit.sigma_std_1_s[i]),
        None if fewer is None else max(1.0 - _residual_ratio(fit, fewer), 0.0),
        why,
    )


def _residual_ratio(fit: _AnyFit, fewer: _AnyFit) -> float:
    """Return the power of the residual of a fit over that of one with fewer modes; in time that of the innovation."""
    if isinstance(fit, TimeFit) and isinstance(fewer, TimeFit):
        return float(np.mean((fit.noise_std / fewer.noise_std) ** 2))
    return fit.chi2 / fewer.chi2 if fewer.chi2 > 0.0 else 1.0


def same_place(model: ModalModel) -> list[tuple[int, int]]:
    """Return the pairs of swinging blocks that are closer than their widths and act alike, the closest first.

    Modes of two axes may have one frequency: they act on different outputs, or from different inputs, and each is
    needed.
    """
    omega, sigma = model.omega_rad_s, model.sigma_1_s
    residues = residues_of(model)
    found = []
    for i, j in combinations(np.flatnonzero((omega > 0.0) & (sigma < omega)).tolist(), 2):
        apart = abs(omega[i] - omega[j]) / (sigma[i] + sigma[j])
        sizes = np.linalg.norm(residues[i]) * np.linalg.norm(residues[j])
        if apart < 1.0 and abs(np.vdot(residues[i], residues[j])) > ALIKE * sizes:
            found.append((float(apart), i, j))
    return [(i, j) for _, i, j in sorted(found)]


def residues_of(model: ModalModel) -> ComplexArray:
    """Return how each block enters each entry at its own frequency, N0 + i omega N1, shape (m, n_y, n_u)."""
    part = participation(model)
    return np.asarray(part.n0 + 1j * model.omega_rad_s[:, None, None] * part.n1)


def _needed(fit: _AnyFit, fewer: _AnyFit) -> bool:
    """Tell whether a mode that `fewer` has not explains more than half of what that leaves.

    Its numbers may be poorly known, as those of a pole that stands for what lies above the band; it is there.
    """
    if isinstance(fit, TimeFit):  # the criterion is twice a logarithm of likelihood, of so many samples
        return bool(fewer.criterion - fit.criterion > np.log(LEAVES) * fit.dof)
    return fewer.chi2 > LEAVES * max(fit.chi2, fit.dof)
