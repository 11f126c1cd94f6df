"""Starts for fits of frequency responses: a whole model by vector fitting, and the exchange of single blocks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.identification.modal_parameters import Structure, participation
from analysis.identification.response_fit import Target, block_states, model_response
from analysis.identification.vector_fitting import PoleResidues, vector_fit
from analysis.linear.modal_form import (
    balanced_truncation,
    block_of,
    canonical,
    modal_from_poles,
    modal_from_state_space,
)
from sim_backend.linear import Array, ModalModel

ComplexArray = NDArray[np.complex128]


# delays tried for a start, in periods of the highest frequency; the refinement bridges the gaps
_DELAYS = (0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0)


def starting_models(target: Target, blocks: int, structure: Structure) -> Iterator[ModalModel]:
    """Yield initial models of `blocks` second-order blocks: vector fitting, then balanced truncation to that order.

    Where a delay may be estimated, there is one for each of several delays, which are taken out of the response first.
    """
    if not structure.delay:
        yield _undelayed_start(target, blocks, structure)
        return
    for delay_s in np.array(_DELAYS) / target.frequency_hz[-1]:
        advance = np.exp(2j * np.pi * target.frequency_hz * delay_s)[:, None, None]
        model = _undelayed_start(replace(target, response=target.response * advance), blocks, structure)
        yield model.with_(delay_s=np.full(model.n_inputs, delay_s))


def _undelayed_start(target: Target, blocks: int, structure: Structure) -> ModalModel:
    """Return a start whose delays are zero."""
    args = (target.weight, target.hold_rate_hz, structure.feedthrough)
    fitted = vector_fit(target.frequency_hz, target.response, 2 * blocks, *args)
    n_y, n_u = target.response.shape[1:]
    ones = np.ones((2 * blocks, 1), dtype=complex)
    if n_u == 1:
        model = modal_from_poles(fitted.poles, fitted.residues[:, :, 0], ones, fitted.d)
    elif n_y == 1:
        model = modal_from_poles(fitted.poles, ones, fitted.residues[:, 0, :], fitted.d)
    else:
        a, b, c = _realise(fitted)
        shift = 0.2 * np.pi * target.frequency_hz[target.frequency_hz > 0.0][0]
        a, b, c, _ = balanced_truncation(a, b, c, 2 * blocks, shift)
        model = modal_from_state_space(a, b, c, fitted.d)
    return _as_mechanical(model, target) if structure.form == "mechanical" else model


def _realise(fitted: PoleResidues) -> tuple[Array, Array, Array]:
    """Return a real state space (A, B, C) with every pole repeated once per rank of its residue (Gilbert 1963)."""
    a, b, c = [], [], []
    for pole, residue in zip(fitted.poles, fitted.residues, strict=True):
        if pole.imag < 0.0:
            continue
        left, size, right = np.linalg.svd(residue)
        for k in np.flatnonzero(size > 1e-9 * size[0]):
            out, into = left[:, k] * np.sqrt(size[k]), right[k] * np.sqrt(size[k])
            if pole.imag == 0.0:
                a.append(np.array([[pole.real]]))
                b.append(into.real[None])
                c.append(out.real[:, None])
            else:
                a.append(np.array([[pole.real, pole.imag], [-pole.imag, pole.real]]))
                # states are sqrt(2) (Re, -Im) of the complex one, which follows x' = p x + into u
                b.append(np.sqrt(2.0) * np.stack([into.real, -into.imag]))
                c.append(np.sqrt(2.0) * np.stack([out.real, out.imag], axis=1))
    return scipy.linalg.block_diag(*a), np.concatenate(b), np.concatenate(c, axis=1)


def _as_mechanical(model: ModalModel, target: Target) -> ModalModel:
    """Return the model with b_direct = c_rate = 0 and rank-one participation fitted anew for its poles."""
    position = block_states(model, target)[0].T[:, None]
    n0 = _least_squares(position[:, 0], target, target.response - model.d)
    left, size, right = np.linalg.svd(n0, full_matrices=False)
    b, c = right[:, 0, :], (left[:, :, 0] * size[:, :1]).T
    return canonical(model.with_(b=b, c=c, b_direct=np.zeros_like(b), c_rate=np.zeros_like(c)))


def _least_squares(basis: ComplexArray, target: Target, goal: ComplexArray) -> Array:
    """Return real coefficients (k, n_y, n_u) of `basis` (n_f, k) that fit `goal` entry by entry under the weights."""
    n_y, n_u = goal.shape[1:]
    coefficient = np.empty((basis.shape[1], n_y, n_u))
    for y, u in np.ndindex(n_y, n_u):
        w = target.weight[:, y, u]
        system, data = w[:, None] * basis, w * goal[:, y, u]
        column = np.linalg.norm(system, axis=0)
        column = np.where(column > 0.0, column, 1.0)
        tall = np.concatenate([system.real, system.imag]) / column
        coefficient[:, y, u] = np.linalg.lstsq(tall, np.concatenate([data.real, data.imag]), rcond=None)[0] / column
    return coefficient


def with_new_block(target: Target, model: ModalModel, structure: Structure) -> ModalModel:
    """Return the model with one more lightly damped block, where the weighted residual has its largest peak."""
    residual = target.response - model_response(model, target)
    power = np.sum(np.abs(target.weight * residual) ** 2, axis=(1, 2))
    # five lines together, so that one noisy line is not taken for a resonance
    peak = int(np.argmax(np.convolve(power, np.ones(5), mode="same")))
    omega = 2.0 * np.pi * max(target.frequency_hz[peak], target.frequency_hz[-1] * 1e-6)
    pole = omega * complex(-0.01, np.sqrt(1.0 - 0.01**2))
    ones = np.ones((2, 1), dtype=complex)
    single = modal_from_poles(np.array([pole, pole.conj()]), ones, ones, np.zeros((1, 1)))
    q, v = block_states(single, target)[:, 0]
    if structure.form == "mechanical":
        n0 = _least_squares(q[:, None], target, residual)[0]
        n1 = np.zeros_like(n0)
    else:
        n0, n1 = _least_squares(np.stack([q, v], axis=1), target, residual)
    return model.beside(block_of(pole, n0, n1, mechanical=structure.form == "mechanical"))


def without_weakest_block(target: Target, model: ModalModel) -> ModalModel:
    """Return the model without the block whose loss, made good by D alone, raises the cost least."""
    (q, v), part = block_states(model, target), participation(model)
    residual = model_response(model, target) - target.response
    costs = []
    for i in range(model.n_blocks):
        lost = q[i][:, None, None] * part.n0[i] + v[i][:, None, None] * part.n1[i]
        weighted = target.weight * (residual - lost)
        constant = (target.weight * weighted).real.sum(axis=0) / (target.weight**2).sum(axis=0)
        costs.append(np.sum(np.abs(weighted - target.weight * constant) ** 2))
    keep = np.arange(model.n_blocks) != int(np.argmin(costs))
    return model.only(keep)
