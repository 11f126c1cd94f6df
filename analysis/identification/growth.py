"""A start with more blocks from a fit with fewer: new ones stand where the fit leaves most.

Starts made at once for all blocks, from a response or by the subspace method, put poles where nothing was played (a
chirp ends somewhere), and miss a mode that any eye sees in what a smaller model leaves.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from analysis.identification.time_residual import TimeTarget
from analysis.linear.modal_form import block_of
from analysis.linear.simulate import simulate_linear
from sim_backend.linear import Array, ModalModel, discretise

DAMPING_RATIO = 0.03
"""Of a new block: its peak is a dozen lines wide in a record of two hundred periods, and a fit goes on from there."""


def grown(
    target: TimeTarget, model: ModalModel, modelled: Sequence[Array], blocks: int, *, mechanical: bool
) -> ModalModel:
    """Return `model` with new blocks up to `blocks`, one after the other where the rest of the records is largest.

    `modelled` are its outputs (n, n_y), initial states and offsets included; `mechanical` blocks have no direct parts.
    """
    rest = [y - m for y, m in zip(target.outputs, modelled, strict=True)]
    for _ in range(blocks - model.n_blocks):
        block, explained = _new_block(target, rest, mechanical=mechanical)
        model = model.beside(block)
        rest = [r - e for r, e in zip(rest, explained, strict=True)]
    return model


def _new_block(target: TimeTarget, rest: Sequence[Array], *, mechanical: bool) -> tuple[ModalModel, list[Array]]:
    """Return a lightly damped block at the largest peak of the residual, and the outputs (n, n_y) that it gives."""
    omega = 2.0 * np.pi * _peak_hz(target, rest)
    pole = omega * complex(-DAMPING_RATIO, np.sqrt(1.0 - DAMPING_RATIO**2))
    n_u, n_y = target.inputs[0].shape[1], rest[0].shape[1]
    states = np.concatenate([states_of_a_block(omega, u, target.rate_hz) for u in target.inputs])  # (samples, 2 n_u)
    size = np.linalg.norm(states, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    columns = states[:, :n_u] / size[:n_u] if mechanical else states / size
    found = np.linalg.lstsq(columns, np.concatenate(list(rest)), rcond=1e-9)[0].T / size[: columns.shape[1]]
    n0, n1 = found[:, :n_u], np.zeros((n_y, n_u)) if mechanical else found[:, n_u:]
    block = block_of(pole, n0, n1, mechanical=mechanical)
    discrete = discretise(block, target.rate_hz)
    return block, [simulate_linear(discrete, u) for u in target.inputs]


def _peak_hz(target: TimeTarget, rest: Sequence[Array]) -> float:
    """Return where the spectrum of the residual has its largest peak, in the record that holds most of it."""
    scaled = [r * target.whitening[:, 0] for r in rest]
    most = max(scaled, key=lambda r: float(np.sum(r**2)))
    window = scipy.signal.get_window("hann", most.shape[0])[:, None]
    power = np.sum(np.abs(scipy.fft.rfft(most * window, axis=0)) ** 2, axis=1)
    line = 1 + int(np.argmax(power[1:]))
    return float(line * target.rate_hz / most.shape[0])


def states_of_a_block(omega: float, u: Array, rate_hz: float) -> Array:
    """Return position and rate (n, 2 n_u) of a lightly damped block, driven from rest by each input (n, n_u) alone."""
    one, none = np.ones((1, 1)), np.zeros((1, 1))
    block = ModalModel(
        omega_rad_s=np.array([omega]),
        sigma_1_s=np.array([DAMPING_RATIO * omega]),
        b=one,
        b_direct=none,
        c=np.array([[1.0], [0.0]]),
        c_rate=np.array([[0.0], [1.0]]),
        d=np.zeros((2, 1)),
        delay_s=np.zeros(1),
    )
    discrete = discretise(block, rate_hz)
    moved = [simulate_linear(discrete, u[:, [j]]) for j in range(u.shape[1])]
    return np.concatenate([m[:, [0]] for m in moved] + [m[:, [1]] for m in moved], axis=1)
