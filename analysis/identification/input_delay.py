"""Whether the inputs of a recorded bench act at once or late: fits with a delay beside fits without."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.identification.determined import SIGNIFICANT, determinedness
from analysis.identification.modal_parameters import Structure
from analysis.identification.timefit import TimeFit, fit_records
from analysis.identification.whitening import holds_inputs
from analysis.identification.whole_delay import IntArray, beginning, freed
from sim_backend.linear import Array, ModalModel

_CLEARLY = 2.0 * float(np.log(99.0))
"""By how much the criterion (twice a logarithm of evidence) must fall: a hundred to one."""

Search = Callable[[Sequence[Array], Sequence[Array]], TimeFit]


def fit_whole_delay(
    search: Search,
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    rate_hz: float,
    orders: tuple[int, ...],
    structure: Structure,
) -> TimeFit:
    """Return the fit of `search` to records, freed of whole samples of delay where that explains them clearly better.

    Shapes: every record's input (n, n_u) and output (n, n_y). Modes imitate a delay one by one, so that it has to be
    known before they are counted. It is proposed by a regression, held against none by fits of as few modes as that
    needs, and decided by fits of as many as there are.
    """
    proposed = beginning(inputs, outputs)
    if not np.any(proposed.whole):
        return search(inputs, outputs)
    unknown, few = int(proposed.whole.max()), int(np.clip(proposed.order // 2, orders[0], orders[-1]))
    records = [freed(inputs, outputs, late, unknown) for late in (proposed.whole, 0 * proposed.whole)]
    late, plain = (fit_records(*some, rate_hz, few, structure=structure, rigid_bodies=None) for some in records)
    if late.criterion + _CLEARLY >= plain.criterion:
        return search(inputs, outputs)
    # a delay may have stood for what fewer modes than there are cannot do
    late, plain = (search(*some) for some in records)
    if late.criterion + _CLEARLY >= plain.criterion:
        return search(inputs, outputs)
    return _later(late, proposed.whole, rate_hz)


def with_delay(fit: TimeFit, inputs: Sequence[Array], outputs: Sequence[Array], rate_hz: float) -> TimeFit:
    """Return `fit`, or one whose inputs act a part of a sample late where that explains the records clearly better.

    Shapes: every record's input (n, n_u) and output (n, n_y). Without a delay its modes imitate it as well as they can;
    what they cannot would be found later as a delay that the bench has and the model lacks.

    What acts a part of a sample late on held steps is exactly what acts at the next whole sample and has a direct path.
    A free delay stands for fewer numbers, and is exact at low frequencies. Either is tried with all modes and without
    the fastest, which may have been the imitation. Where no mode is as fast as a sample, and the inputs explain nothing
    of what `fit` leaves, there is nothing that a delay could be told from.
    """
    if np.abs(fit.model.poles_1_s()).max(initial=0.0) < rate_hz and not _holds_inputs(fit, inputs, outputs):
        return fit
    known = np.rint(fit.model.delay_s * rate_hz).astype(np.intp)
    proposed = beginning(inputs, outputs).whole
    bases = [known] if np.array_equal(known, proposed) else [known, proposed]
    unknown = int(max(base.max() for base in bases)) + 1
    bare = fit.model.with_(delay_s=np.zeros(known.size))
    reference = _again(freed(inputs, outputs, known, unknown), rate_hz, fit.structure, bare)
    starts = [bare]
    if bare.n_blocks > 1:
        starts.append(bare.only(np.arange(bare.n_blocks) != int(np.argmax(np.abs(bare.poles_1_s()).max(axis=1)))))
    free = replace(fit.structure, delay=True)
    found = []
    for base in bases:
        own, next_one = (freed(inputs, outputs, whole, unknown) for whole in (base, base + 1))
        for start in starts:
            late = _again(own, rate_hz, free, start.with_(delay_s=np.full(known.size, 0.5 / rate_hz)))
            found += [_later(late, base, rate_hz)] if np.all(_known(late)) else []
            if fit.structure.feedthrough:
                found.append(_later(_again(next_one, rate_hz, fit.structure, start), base + 1, rate_hz))
    # a mode that nobody knows is no price for a delay
    found = [one for one in found if _doubtful(one) <= _doubtful(reference)]
    best = min(found, key=lambda one: one.criterion, default=reference)
    if best.model.n_blocks < bare.n_blocks:
        # it may be the mode given up that pays, and not the delay
        plain = _again(freed(inputs, outputs, known, unknown), rate_hz, fit.structure, starts[-1])
        if plain.criterion < reference.criterion and _doubtful(plain) <= _doubtful(reference):
            fit, reference = _later(plain, known, rate_hz), plain
    paths = fit.model.n_inputs * fit.model.n_outputs
    return best if best.criterion + paths * _CLEARLY < reference.criterion else fit


def _again(
    records: tuple[list[Array], list[Array]], rate_hz: float, structure: Structure, start: ModalModel
) -> TimeFit:
    return fit_records(*records, rate_hz, start.n_blocks, structure=structure, rigid_bodies=None, start=start)


def _later(fit: TimeFit, whole: IntArray, rate_hz: float) -> TimeFit:
    """Return a fit to records that were freed of `whole` (n_u,) samples, with these in its model."""
    return replace(fit, model=fit.model.with_(delay_s=fit.model.delay_s + whole / rate_hz))


def _holds_inputs(fit: TimeFit, inputs: Sequence[Array], outputs: Sequence[Array]) -> bool:
    """Tell whether inputs explain some of what a fit leaves; the first rows of a record may be left out of the fit."""
    kept = [
        (u[u.shape[0] - m.shape[0] :], y[y.shape[0] - m.shape[0] :] - m)
        for u, y, m in zip(inputs, outputs, fit.outputs, strict=True)
    ]
    return holds_inputs([error for _, error in kept], [u for u, _ in kept])


def _doubtful(fit: TimeFit) -> int:
    return int(np.sum(determinedness(fit) < SIGNIFICANT))


def _known(fit: TimeFit) -> NDArray[np.bool_]:
    """Return which delays (n_u,) are none, or differ from none by what is no uncertainty of theirs.

    Where no linear model explains the record, the evidence counts a little help as much.
    """
    std = np.sqrt(np.diag(fit.covariance)[fit.layout.index("delay_s")])
    return (fit.model.delay_s == 0.0) | (fit.model.delay_s >= SIGNIFICANT * std)
