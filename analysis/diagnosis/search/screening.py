"""From data, model and whitener to the inner products of all candidates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.candidates.signature import Candidate, Motion, signature
from analysis.diagnosis.fitting.starts import Start
from analysis.diagnosis.noise.whitener import TOGETHER, Whitener
from analysis.diagnosis.nominal.tuning import Nuisance, root_of
from analysis.diagnosis.records.dataset import Dataset, Record
from analysis.diagnosis.search.gram import COLLINEAR, Gram, beside_start
from analysis.diagnosis.side_by_side import side_by_side
from campaigns.facts.base import stretches_of
from sim_backend.assembly import Places
from sim_backend.linear import Array, ModalModel

Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

_PIECE = 4096

Noise = tuple[Whitener, tuple[Start, ...]]
"""A noise and, under it, the start bases of all records."""


@dataclass(frozen=True)
class Footing:
    """What screening starts from: the data, the adjusted linear model, its nuisances and their present change.

    `exact` (one (n, n_y, k) per record) holds the sensitivities to the nuisances and then to the parameters of effects
    that are already in the model; `plain` those to the nuisances of the linear model by itself, nothing where that is
    all there is. `states` (m, 2) per record are those in which they start.
    """

    data: Dataset
    linear: ModalModel
    places: Places
    nuisances: list[Nuisance]
    change: Array
    starts: tuple[Start, ...]
    exact: tuple[Array, ...]
    plain: tuple[Array, ...]
    states: tuple[Array, ...]


def gram_of(
    footing: Footing,
    motions: Sequence[Motion],
    whitener: Whitener,
    candidates: Sequence[Candidate],
    *,
    workers: int = 2,
    others: Sequence[Noise] = (),
) -> list[Gram]:
    """Return the inner products of residual, nuisances and all candidates over the samples that may be fitted.

    The first are those under the noise of `whitener`, then come those under `others`.
    """

    def columns(r: int) -> list[Array]:
        def column(candidate: Candidate) -> Array:
            states, rate_hz = footing.states[r], footing.data.rate_hz
            return signature(candidate, footing.linear, footing.places, motions[r], rate_hz, states, r)

        return list(side_by_side(column, candidates, workers=workers))

    grams = gathered(footing, motions, whitener, columns, tuple(map(_one_sided, candidates)), others, workers)
    whole = tuple(c.effect.whole for c in candidates)
    return [replace(gram, whole=whole) for gram in grams]


def gathered(
    footing: Footing,
    motions: Sequence[Motion],
    whitener: Whitener,
    columns: Callable[[int], Sequence[Array]],
    one_sided: tuple[bool, ...],
    others: Sequence[Noise] = (),
    workers: int = 2,
) -> list[Gram]:
    """Return the inner products of residual, nuisances and `columns` over the samples that may be fitted.

    `columns` gives those of a record by its number, one (n, n_y, k) for each group; `one_sided` tells which groups can
    only be positive. Records and outputs are taken one after another, so that memory holds one record's columns only.
    The first products are those under the noise of `whitener`, then come those under each of `others`, which may differ
    from it in the levels of its bands: few coefficients, so that they cost next to nothing.
    """
    totals: list[Array] = []
    by_output = np.zeros((0, 0))
    widths: list[int] = []
    rows = 0
    for r, (record, motion) in enumerate(zip(footing.data.records, motions, strict=True)):
        rows += int(record.fitted().sum()) * footing.data.n_outputs
        found = columns(r)
        widths = [c.shape[2] for c in found]
        known = [footing.exact[r], *(p[r] for p in (footing.plain,) if p)]
        noises = [(w, starts[r]) for w, starts in ((whitener, footing.starts), *others)]
        products, energies = _products([motion.residual[:, :, None], *known, *found], record, noises, workers)
        totals = products if r == 0 else [t + p for t, p in zip(totals, products, strict=True)]
        by_output = energies if r == 0 else by_output + energies
    n_before = footing.exact[0].shape[2]
    ends = 1 + n_before + np.cumsum(widths, dtype=np.int64)
    groups = tuple(np.arange(end - width, end) for end, width in zip(ends, widths, strict=True))
    if footing.plain:
        totals = [_carried(total, n_before, len(footing.nuisances)) for total in totals]
        by_output = np.delete(by_output, 1 + n_before + np.arange(len(footing.nuisances)), axis=1)
    return [
        Gram(_held(total, footing), n_before, groups, one_sided, rows, whitener.repeats, by_output=by_output)
        for total in totals
    ]


def _held(products: Array, footing: Footing) -> Array:
    """Return products with the prior of the nuisances' changes from the nominal model, as additional matrix rows."""
    out, at = products.copy(), np.arange(1, 1 + len(footing.nuisances))
    root = root_of(footing.nuisances)
    change = root @ footing.change
    out[np.ix_(at, at)] += root.T @ root
    out[0, at] -= root.T @ change
    out[at, 0] -= root.T @ change
    out[0, 0] += float(change @ change)
    return out


def _carried(products: Array, n_exact: int, n_nuisances: int) -> Array:
    """Return products without the linear model's sensitivities, which correct columns collinear with nuisances.

    A column is the linear model's response to a change. Where the model holds more, the nuisances' exact columns differ
    from it, and a change that is theirs (a stiffness, a gain) would be significant by the difference of the two, or be
    hidden in it. The exact columns replace such a column in the same proportions.
    """
    exact = np.arange(1, 1 + n_nuisances)
    plain = 1 + n_exact + np.arange(n_nuisances)
    kept = np.delete(np.arange(products.shape[0]), plain)
    own = kept[kept > n_exact]
    shares, left = _proportions(products, plain, own)
    # a reading's error runs along the motion as it is, and is the exact columns' already
    moved = (left < COLLINEAR * np.diag(products)[own]) & (left < _proportions(products, exact, own)[1])
    at, parts = own[moved], shares[:, moved]
    change = (products[:, exact] - products[:, plain]) @ parts
    out = products.copy()
    out[:, at] += change
    out[at] += change.T
    out[np.ix_(at, at)] += parts.T @ (change[exact] - change[plain])
    return np.asarray(out[np.ix_(kept, kept)])


def _proportions(products: Array, by: Ints, columns: Ints) -> tuple[Array, Array]:
    """Return the proportions (n_by, n) in which the columns `by` fit others best, and the tolerance of each (n,)."""
    scale = np.sqrt(np.maximum(np.diag(products)[by], np.finfo(float).tiny))
    cross = products[np.ix_(by, columns)] / scale[:, None]
    shares = np.linalg.lstsq(products[np.ix_(by, by)] / np.outer(scale, scale), cross, rcond=1e-14)[0]
    return shares / scale[:, None], np.diag(products)[columns] - np.sum(cross * shares, axis=0)


def _one_sided(candidate: Candidate) -> bool:
    """Tell whether the candidate's columns can only be positive: sizes that cannot be negative, or a whole effect."""
    return all(p.low >= 0.0 for p in candidate.effect.parameters() if p.size)


def _products(
    parts: Sequence[Array], record: Record, noises: Sequence[tuple[Whitener, Start]], workers: int
) -> tuple[list[Array], Array]:
    """Return the inner products of one record's columns after whitening, its unknown start projected out, per noise.

    The second are the squares of the columns in each output, (n_y, n), under the first noise before that projection.
    Output by output, because most columns move one output only and need no arithmetic in the others.
    """
    width = sum(p.shape[2] for p in parts)
    mask = record.fitted()
    rows = int(mask.sum())
    whitener = noises[0][0]
    totals = [np.zeros((width, width)) for _ in noises]
    seen = [np.zeros((start.q.shape[1], width)) for _, start in noises]
    energies = np.zeros((record.y.shape[1], width))
    for o in range(record.y.shape[1]):
        columns = [part[:, o, k] for part in parts for k in range(part.shape[2])]
        live = np.array([i for i, column in enumerate(columns) if _moves(column)], dtype=np.int64)
        white = _whitened([columns[i] for i in live], mask, whitener, o, workers)
        white *= record.weight
        own = white.T @ white
        energies[o, live] = np.diag(own)
        for k, (noise, start) in enumerate(noises):
            at, louder = _relative(whitener, noise, mask, o)
            few, q = white[at], start.q[o * rows : (o + 1) * rows]
            totals[k][np.ix_(live, live)] += own + few.T @ ((louder**2 - 1.0)[:, None] * few) if at.size else own
            seen[k][:, live] += q.T @ white + q[at].T @ ((louder - 1.0)[:, None] * few)
    return [beside_start(total, s) for total, s in zip(totals, seen, strict=True)], energies


def _whitened(columns: Sequence[Array], mask: Mask, whitener: Whitener, output: int, workers: int) -> Array:
    """Return the masked samples of `columns`, each (n,) of one output, whitened: (samples, len(columns)).

    A few at a time, so that there is one copy of the columns: they are the most that a diagnosis holds.
    """
    white = np.empty((len(columns), int(mask.sum())))

    def fill(first: int) -> None:
        some = columns[first : first + TOGETHER]
        whitener.fill_rows(np.stack(some), mask, output, white[first : first + len(some)])

    list(side_by_side(fill, range(0, len(columns), TOGETHER), workers=workers))
    return white.T


def _moves(column: Array) -> bool:
    """Tell whether a column (n,) is anywhere but zero; piece by piece, for of most the first piece says it."""
    return any(column[first : first + _PIECE].any() for first in range(0, column.size, _PIECE))


def _relative(whitener: Whitener, other: Whitener, mask: Mask, output: int) -> tuple[Ints, Array]:
    """Return which of the masked samples `other` whitens to another size, and to how many times that of `whitener`."""
    at, ratio, first = [np.zeros(0, np.int64)], [np.zeros(0)], 0
    if other is not whitener and whitener.levels.size:
        for start, stop in stretches_of(mask):
            own, others = (w.band_levels(stop - start, output) for w in (whitener, other))
            differ = np.flatnonzero(own != others)
            at.append(first + differ)
            ratio.append(np.sqrt(own[differ] / others[differ]))
            first += stop - start
    return np.concatenate(at), np.concatenate(ratio)
