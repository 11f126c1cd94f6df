"""From data, model and whitener to the inner products of all candidates."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.candidates import Candidate, Motion, signature
from analysis.diagnosis.dataset import Dataset
from analysis.diagnosis.gram import Gram
from analysis.diagnosis.noise import Whitener
from analysis.diagnosis.responses import free_responses
from analysis.diagnosis.tuning import Knob, sensitivities
from sim_backend.assembly import Places
from sim_backend.linear import ModalModel, discretise

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Problem:
    """What screening starts from: the data, the (re-tuned) linear model, its knobs and their present change."""

    data: Dataset
    linear: ModalModel
    places: Places
    knobs: list[Knob]
    change: Array


def gram_of(
    problem: Problem,
    motions: Sequence[Motion],
    whitener: Whitener,
    candidates: Sequence[Candidate],
    *,
    workers: int = 2,
) -> Gram:
    """Return the inner products of residual, knobs and all candidates over the rows that may be fitted.

    Records and outputs are taken one after another, so that memory holds one record's columns only.
    """
    groups, n_columns = _number(candidates, 1 + len(problem.knobs))
    total = np.zeros((n_columns, n_columns))
    rows = 0
    for record, motion in zip(problem.data.records, motions, strict=True):
        mask = record.fitted()
        if not mask.any():
            continue

        def column(candidate: Candidate, motion: Motion = motion) -> Array:
            return signature(candidate, problem.linear, problem.places, motion, problem.data.rate_hz)

        with ThreadPoolExecutor(workers) as pool:
            found = list(pool.map(column, candidates))
        knobs = sensitivities(problem.linear, problem.knobs, record.u, problem.data.rate_hz)
        free = free_responses(discretise(problem.linear, problem.data.rate_hz), record.n)
        for o in range(problem.data.n_outputs):
            parts = [motion.residual[:, o : o + 1], knobs[:, o], *(f[:, o] for f in found)]
            total += _products(np.concatenate(parts, axis=1), free[:, o], mask, whitener, o)
        rows += int(mask.sum()) * problem.data.n_outputs
    # prior: the total change of each knob from the nominal model is normal with its sd
    precision = np.array([1.0 / k.sd**2 for k in problem.knobs])
    at = np.arange(1, 1 + len(problem.knobs))
    total[at, at] += precision
    total[0, at] -= precision * problem.change
    total[at, 0] -= precision * problem.change
    total[0, 0] += float(precision @ problem.change**2)
    return Gram(total, len(problem.knobs), groups, rows, whitener.repeats)


def _number(candidates: Sequence[Candidate], first: int) -> tuple[tuple[Array, ...], int]:
    groups, at = [], first
    for c in candidates:
        width = max(len(c.unit_sizes), 1)
        groups.append(np.arange(at, at + width))
        at += width
    return tuple(groups), at


def _products(columns: Array, free: Array, mask: Array, whitener: Whitener, output: int) -> Array:
    """Return the inner products of one output's columns after whitening, the unknown start projected out."""
    live = np.flatnonzero(np.any(columns != 0.0, axis=0))
    white = whitener.apply(columns[:, live], output)[mask]
    starts = free[:, np.any(free != 0.0, axis=0)]
    if starts.shape[1]:
        start = whitener.apply(starts, output)[mask]
        q, r = np.linalg.qr(start)
        keep = np.abs(np.diag(r)) > 1e-9 * np.max(np.abs(np.diag(r)), initial=1e-300)
        white -= q[:, keep] @ (q[:, keep].T @ white)
    full = np.zeros((columns.shape[1], columns.shape[1]))
    full[np.ix_(live, live)] = white.T @ white
    return full
