"""Whether the inputs of a recorded bench act at once or late: fits with a delay beside fits without."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.identification.determined import SIGNIFICANT, determinedness, dropped_from
from analysis.identification.dropped import DELAY
from analysis.identification.modal_parameters import Structure
from analysis.identification.timefit import TimeFit, fit_records
from analysis.identification.whitening import holds_inputs
from analysis.identification.whole_delay import LATEST, IntArray, beginning, freed
from sim_backend.linear import Array, ModalModel

_CLEARLY = 2.0 * float(np.log(99.0))
"""By how much the criterion (twice a logarithm of evidence) must fall: a hundred to one."""

_IMITATING = 2
"""Modes more than there are with which a fit may do what a delay does: each turns the phase by 180°."""

_EARLIER = 2
"""Samples by which a regression may have called a delay too long: what a slow mode does at first is below the noise."""

_PATIENCE = 2
"""Modes given up in succession without a gain: one that only approximates the delay may be between two modes."""

Search = Callable[[Sequence[Array], Sequence[Array]], TimeFit]


def fit_whole_delay(
    search: Search,
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    rate_hz: float,
    orders: tuple[int, ...],
    structure: Structure,
) -> TimeFit:
    """Return the fit of `search` to records, with whole samples of delay removed where that is clearly better.

    Shapes: every record's input (n, n_u) and output (n, n_y). Modes can approximate a delay one by one, so it has to be
    known before they are counted. It is proposed by a regression; then a search among modes without it is compared with
    fits without a delay that have as many modes, and up to `_IMITATING` more.
    """
    proposed = beginning(inputs, outputs)
    if not np.any(proposed.whole):
        return search(inputs, outputs)
    unknown = int(proposed.whole.max())
    late = search(*freed(inputs, outputs, proposed.whole, unknown))
    plain = freed(inputs, outputs, 0 * proposed.whole, unknown)
    fewest, values = late.model.n_blocks, sum(y.size for y in plain[1])
    for n in range(fewest, min(fewest + _IMITATING, max(orders[-1], fewest)) + 1):
        other = fit_records(*plain, rate_hz, n, structure=structure, rigid_bodies=None)
        if late.criterion + _CLEARLY >= other.criterion:
            return search(inputs, outputs)
        # no more modes can explain more than what the noise leaves
        if 2.0 * values * float(np.mean(np.log(other.noise_std / late.noise_std))) < np.log(values):
            break
    return _later(late, proposed.whole, rate_hz)


def with_delay(fit: TimeFit, inputs: Sequence[Array], outputs: Sequence[Array], rate_hz: float) -> TimeFit:
    """Return `fit`, or one whose inputs act a fraction of a sample late where that is clearly better.

    Shapes: every record's input (n, n_u) and output (n, n_y). Without a delay its modes absorb it as well as they can;
    the rest would be found later as a delay that the bench has and the model lacks.

    On held steps, a delay of a fraction of a sample is exactly a direct path beside a delay of the next whole sample. A
    free delay needs fewer numbers, and fewest without the direct paths and rates that act like it. Either is tried
    with all modes, and a free one with ever fewer: the fastest modes may only have approximated it.
    """
    given = fit
    known = np.rint(fit.model.delay_s * rate_hz).astype(np.intp)
    proposed = beginning(inputs, outputs).whole
    bases = [known] if np.array_equal(known, proposed) else [known, proposed]
    # more samples are left out than these need: a free delay may turn out longer, and what was played before is not
    # known
    unknown = max(*(int(base.max()) + 1 for base in bases), min(LATEST, min(y.shape[0] for y in outputs) // 20))
    bare = fit.model.with_(delay_s=np.zeros(known.size))
    if bare.n_blocks == 1 and np.abs(bare.poles_1_s()).max() < rate_hz and not _holds_inputs(fit, inputs, outputs):
        return fit  # nothing determines a delay
    reference = _again(freed(inputs, outputs, known, unknown), rate_hz, fit.structure, bare)
    found = []
    simple = replace(fit.structure, form="mechanical", feedthrough=False)
    for base in bases:
        found += _free_delays(bare, base, inputs, outputs, rate_hz, fit.structure, unknown)
        found += _free_delays(mechanical(bare), base, inputs, outputs, rate_hz, simple, unknown)
        if fit.structure.feedthrough:
            next_one = freed(inputs, outputs, base + 1, unknown)
            starts = [bare] if bare.n_blocks == 1 else [bare, _slower(bare)]
            found += [_later(_again(next_one, rate_hz, fit.structure, one), base + 1, rate_hz) for one in starts]
    # a mode that nobody knows is no price for a delay
    found = [one for one in found if _doubtful(one) <= _doubtful(reference)]
    best = min(found, key=lambda one: one.criterion, default=reference)
    if best.model.n_blocks < bare.n_blocks:
        # it may be the modes given up that pay, and not the delay
        fewer = bare
        while fewer.n_blocks > best.model.n_blocks:
            fewer = _slower(fewer)
        plain = _again(freed(inputs, outputs, known, unknown), rate_hz, fit.structure, fewer)
        if plain.criterion < reference.criterion and _doubtful(plain) <= _doubtful(reference):
            fit, reference = _later(plain, known, rate_hz), plain
    paths = fit.model.n_inputs * fit.model.n_outputs
    return _with_dropped(best if best.criterion + paths * _CLEARLY < reference.criterion else fit, given)


def _with_dropped(fit: TimeFit, given: TimeFit) -> TimeFit:
    """Return a fit with what had been given up before, and the fastest modes of the `given` one if it has fewer."""
    fastest = np.argsort(-np.abs(given.model.poles_1_s()).max(axis=1))
    fewer = fastest[: given.model.n_blocks - fit.model.n_blocks].tolist()
    return replace(fit, dropped=(*given.dropped, *(dropped_from(given, i, None, DELAY) for i in fewer)))


def _free_delays(
    bare: ModalModel,
    base: IntArray,
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    rate_hz: float,
    structure: Structure,
    unknown: int,
) -> list[TimeFit]:
    """Return fits whose delay is free, begun at `base` (n_u,) samples: with all modes, and with ever fewer fast ones.

    Each begins where the one before ended, until giving up modes does not pay any more. Whole samples of what is found
    are moved into the records, and it is fitted again: otherwise the first samples lack the commands before them.
    """
    free = replace(structure, delay=True)
    earlier = np.maximum(base - _EARLIER, 0)
    start = bare.with_(delay_s=np.asarray((base - earlier + 0.5) / rate_hz))
    found, least, worse = [], np.inf, 0
    while True:
        late = _again(freed(inputs, outputs, earlier, unknown), rate_hz, free, start)
        whole = np.minimum(np.floor(late.model.delay_s * rate_hz).astype(np.intp), unknown - 1 - earlier)
        if np.any(whole > 0):
            earlier = earlier + whole
            start = late.model.with_(delay_s=late.model.delay_s - whole / rate_hz)
            late = _again(freed(inputs, outputs, earlier, unknown), rate_hz, free, start)
        late = _later(late, earlier, rate_hz)
        worse = 0 if late.criterion < least else worse + 1
        least = min(late.criterion, least)
        if np.all(_known(late)):
            found.append(late)
        if start.n_blocks == 1 or worse == _PATIENCE:
            return found
        start = _slower(late.model.with_(delay_s=late.model.delay_s - earlier / rate_hz))


def mechanical(model: ModalModel) -> ModalModel:
    """Return a model whose blocks are masses on springs and no more: what else it has may stand for a delay."""
    return model.with_(
        b_direct=np.zeros_like(model.b_direct), c_rate=np.zeros_like(model.c_rate), d=np.zeros_like(model.d)
    )


def _slower(model: ModalModel) -> ModalModel:
    """Return a model without its fastest block."""
    fastest = int(np.argmax(np.abs(model.poles_1_s()).max(axis=1)))
    return model.only(np.arange(model.n_blocks) != fastest)


def _again(
    records: tuple[list[Array], list[Array]], rate_hz: float, structure: Structure, start: ModalModel
) -> TimeFit:
    return fit_records(*records, rate_hz, start.n_blocks, structure=structure, rigid_bodies=None, start=start)


def _later(fit: TimeFit, whole: IntArray, rate_hz: float) -> TimeFit:
    """Return a fit to records that were freed of `whole` (n_u,) samples, with these in its model."""
    return replace(fit, model=fit.model.with_(delay_s=fit.model.delay_s + whole / rate_hz))


def _holds_inputs(fit: TimeFit, inputs: Sequence[Array], outputs: Sequence[Array]) -> bool:
    """Tell whether inputs explain part of the residual of a fit, which may leave out the first samples of a record."""
    kept = [
        (u[u.shape[0] - m.shape[0] :], y[y.shape[0] - m.shape[0] :] - m)
        for u, y, m in zip(inputs, outputs, fit.outputs, strict=True)
    ]
    return holds_inputs([error for _, error in kept], [u for u, _ in kept])


def _doubtful(fit: TimeFit) -> int:
    return int(np.sum(determinedness(fit) < SIGNIFICANT))


def _known(fit: TimeFit) -> NDArray[np.bool_]:
    """Return which delays (n_u,) are none, or differ from none by what is not an uncertainty of theirs.

    Where no linear model explains the record, the evidence counts a little help as much.
    """
    std = np.sqrt(np.diag(fit.covariance)[fit.layout.index("delay_s")])
    return (fit.model.delay_s == 0.0) | (fit.model.delay_s >= SIGNIFICANT * std)
