"""From data, model and whitener to the inner products of all candidates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.candidates import Candidate, Motion, signature
from analysis.diagnosis.dataset import Dataset, Record
from analysis.diagnosis.gram import Gram
from analysis.diagnosis.noise import Whitener
from analysis.diagnosis.starts import Start
from analysis.diagnosis.tuning import Knob
from sim_backend.assembly import Places
from sim_backend.linear import ModalModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Problem:
    """What screening starts from: the data, the re-tuned linear model, its knobs and their present change.

    `exact` (one (n, n_y, k) per record) holds the sensitivities to the knobs and then to the parameters of effects
    that are already in the model; `states` (m, 2) per record are those in which they start.
    """

    data: Dataset
    linear: ModalModel
    places: Places
    knobs: list[Knob]
    change: Array
    starts: tuple[Start, ...]
    exact: tuple[Array, ...]
    states: tuple[Array, ...]


def gram_of(
    problem: Problem,
    motions: Sequence[Motion],
    whitener: Whitener,
    candidates: Sequence[Candidate],
    *,
    workers: int = 2,
) -> Gram:
    """Return the inner products of residual, knobs and all candidates over the rows that may be fitted."""

    def columns(r: int) -> list[Array]:
        def column(candidate: Candidate) -> Array:
            states, rate_hz = problem.states[r], problem.data.rate_hz
            return signature(candidate, problem.linear, problem.places, motions[r], rate_hz, states, r)

        with ThreadPoolExecutor(workers) as pool:
            return list(pool.map(column, candidates))

    gram = gathered(problem, motions, whitener, columns, tuple(map(_one_sided, candidates)))
    return replace(gram, whole=tuple(c.effect.whole for c in candidates))


def gathered(
    problem: Problem,
    motions: Sequence[Motion],
    whitener: Whitener,
    columns: Callable[[int], Sequence[Array]],
    one_sided: tuple[bool, ...],
) -> Gram:
    """Return the inner products of residual, knobs and `columns` over the rows that may be fitted.

    `columns` gives those of a record by its number, one (n, n_y, k) for each group; `one_sided` tells which groups can
    only be positive. Records and outputs are taken one after another, so that memory holds one record's columns only.
    """
    total: Array = np.zeros((0, 0))
    widths: list[int] = []
    rows = 0
    for r, (record, motion, start) in enumerate(zip(problem.data.records, motions, problem.starts, strict=True)):
        rows += int(record.fitted().sum()) * problem.data.n_outputs
        found = columns(r)
        widths = [c.shape[2] for c in found]
        products = _products([motion.residual[:, :, None], problem.exact[r], *found], record, whitener, start)
        total = products if r == 0 else total + products
    # prior: the total change of each knob from the nominal model is normal with its sd
    precision = np.array([1.0 / k.sd**2 for k in problem.knobs])
    at = np.arange(1, 1 + len(problem.knobs))
    total[at, at] += precision
    total[0, at] -= precision * problem.change
    total[at, 0] -= precision * problem.change
    total[0, 0] += float(precision @ problem.change**2)
    n_before = problem.exact[0].shape[2]
    ends = 1 + n_before + np.cumsum(widths, dtype=np.int64)
    groups = tuple(np.arange(end - width, end) for end, width in zip(ends, widths, strict=True))
    return Gram(total, n_before, groups, one_sided, rows, whitener.repeats)


def _one_sided(candidate: Candidate) -> bool:
    """Tell whether the candidate's columns can only be positive: sizes that cannot be negative, or a whole effect."""
    return all(p.low >= 0.0 for p in candidate.effect.parameters() if p.size)


def _products(parts: Sequence[Array], record: Record, whitener: Whitener, start: Start) -> Array:
    """Return the inner products of one record's columns after whitening, its unknown start projected out.

    Output by output, because most columns move one output only and need no arithmetic in the others.
    """
    width = sum(p.shape[2] for p in parts)
    mask = record.fitted()
    rows = int(mask.sum())
    total, seen = np.zeros((width, width)), np.zeros((start.q.shape[1], width))
    for o in range(record.y.shape[1]):
        columns = np.concatenate([p[:, o] for p in parts], axis=1)
        live = np.flatnonzero(np.any(columns != 0.0, axis=0))
        white = record.weight * whitener.rows(columns[:, live], mask, o)
        total[np.ix_(live, live)] += white.T @ white
        seen[:, live] += start.q[o * rows : (o + 1) * rows].T @ white
    return total - seen.T @ seen
