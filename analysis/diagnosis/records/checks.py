"""Whether records can decide anything: refused with a reason where they cannot, with a note where they decide less.

A record of another bench than the model's is refused before any fit, as no cause in the library is a factor of ten.
Compared are the measured motion and that which the linear model simulates from the recorded inputs, by thirds of an
octave, where the two agree in shape (coherence). A resonance that is a few per cent off differs beside itself alone; a
model of another bench, a wrong unit or a wrong channel differs nearly everywhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analysis.diagnosis.nominal.responses import simulate
from analysis.diagnosis.records.dataset import Mask, Record, Window
from campaigns.facts import Fact
from campaigns.facts.base import stretches_of
from campaigns.facts.clipping import NAME, cut_off
from sim_backend.errors import DataError
from sim_backend.linear import Array, discretise
from sim_backend.model import Model

if TYPE_CHECKING:
    from analysis.diagnosis.records.loading import Loaded


MIN_ROWS = 60
"""Fewest samples that a fit may use: three per output would fit a noise model alone."""

SHORTEST = 8
"""Samples between two cut-off stretches that are worth a window."""

FACTOR = 10.0
"""Ratio of measured to simulated motion, either way, for half of the motion; no listed effect is so large."""

_COHERENT = 0.5
"""Bands in which less of the measured motion follows the simulated one say nothing of its size."""

_MOVES = 0.01
"""Part of the energy of the strongest band from which on the output moves in another."""

_SHOWN = 0.5
"""Part of the energy of the motion below which the bands say nothing of it: slower ones have too few bins."""

_LINES = 16
"""Fewest bins of a band: a coherence of fewer is high by chance."""

_BANDS = 3
"""Fewest bands that a verdict rests on."""

_THIRD = 2.0 ** (1.0 / 3.0)


def check_outputs(records: Sequence[Record], names: Sequence[str], where: str) -> None:
    """Raise DataError when an output (its `names` in order) of the `records` of the log `where` is dead."""
    for o, name in enumerate(names):
        low = min(float(r.y[:, o].min()) for r in records)
        high = max(float(r.y[:, o].max()) for r in records)
        if low == high:
            raise DataError(
                f"{where}: output '{name}' is constant at {low:g} in all samples; a dead channel decides nothing: "
                "leave this run out or mend the channel"
            )


def without_cut_off(
    records: Sequence[Record], names: Sequence[str], facts: Sequence[Fact]
) -> tuple[list[Record], list[str]]:
    """Return the records without the samples where the `facts` say that an output is cut off, and notes.

    Such samples are simulated like all others, but neither fitted nor judged. The outputs of the records have these
    `names`, in order.
    """
    told = [fact for fact in facts if fact.name == NAME and fact.channel in names]
    kept = []
    for record in records:
        cut = np.zeros(record.n, dtype=bool)
        for w in record.windows:
            columns = dict(zip(names, record.y[w.start : w.stop].T, strict=True))
            cut[w.start : w.stop] = cut_off(told, w.label, w.stop - w.start, columns.__getitem__)
        kept.append(replace(record, windows=_around(record.windows, cut), missing=cut) if cut.any() else record)
    notes = [f"{fact.finding}, as a saturated sensor is; those samples are left out" for fact in told]
    if notes and not any(record.windows for record in kept):
        raise DataError(
            f"an output is cut off every few samples ({notes[0].partition(';')[0]}): no stretch of {SHORTEST} "
            "samples remains in between; record with a smaller motion or a wider range"
        )
    return kept, notes


def _around(windows: Sequence[Window], cut: Mask) -> tuple[Window, ...]:
    """Return the pieces of windows in which nothing is `cut` (n,); what remains of periods repeats no more."""
    pieces = []
    for w in windows:
        if not cut[w.start : w.stop].any():
            pieces.append(w)
            continue
        pieces += [
            replace(w, start=w.start + a, stop=w.start + b, period=0)
            for a, b in stretches_of(~cut[w.start : w.stop], SHORTEST)
        ]
    return tuple(pieces)


def check_inputs(records: Sequence[Record], names: Sequence[str]) -> list[str]:
    """Return a note on inputs (their `names` in order) that never move; raises DataError when none does."""
    moves = np.any([np.ptp(r.u, axis=0) > 0.0 for r in records], axis=0)
    if not np.any(moves):
        raise DataError(
            "every input is constant in all runs; nothing was excited, so nothing can be judged: give a run in which "
            "the bench is driven"
        )
    still = [name for name, m in zip(names, moves, strict=True) if not m]
    return [f"input {', '.join(still)} never moves; nothing can be said about it"] if still else []


def check_enough(records: Sequence[Record], where: str) -> None:
    """Raise DataError when too few samples of the `records` of the logs `where` may be fitted."""
    fitted = sum(int(r.fitted().sum()) for r in records)
    if fitted < MIN_ROWS:
        raise DataError(
            f"{where}: {fitted} samples may be fitted, at least {MIN_ROWS} are needed to "
            "distinguish an effect from noise; "
            "record more"
        )


def without_copies(records: Sequence[Record], names: Sequence[str]) -> tuple[tuple[Record, ...], list[str]]:
    """Return the records, their periods forgotten where those of an output are copies of each other, and a note.

    Averaged periods that were tiled, and readings coarser than any noise, differ by nothing: the noise would be zero.
    Where those of all outputs are copies the last one is used alone: four copies of one noise would be four times the
    evidence for whatever it looks like.
    """
    largest = np.zeros(len(names))
    seen = False
    for record in records:
        for w in record.windows:
            if w.repeats:
                y = record.y[w.start : w.stop]
                largest = np.maximum(largest, np.max(np.abs(y[w.period :] - y[: -w.period]), axis=0))
                seen = True
    copied = [name for name, difference in zip(names, largest, strict=True) if difference == 0.0]
    if not seen or not copied:
        return tuple(records), []
    once = len(copied) == len(names)
    if once:
        plain = [_last_copy(r, w) for r in records for w in r.windows]
    else:
        plain = [replace(r, windows=tuple(replace(w, period=0) for w in r.windows)) for r in records]
    taken = "one of them is used" if once else "periods are taken as not repeating"
    return tuple(plain), [
        f"the periods of {', '.join(copied)} are copies of each other, which say nothing about "
        f"the noise; {taken}: give "
        "the record as it was measured, not averaged"
    ]


def _last_copy(record: Record, w: Window) -> Record:
    """Return a record of the last period of a window, of the whole window where that has no two."""
    start = w.stop - w.period if w.repeats else w.start
    return record.cut(start, w.stop, (replace(w, start=0, stop=w.stop - start, period=0),))


def check_same_bench(loaded: Loaded, model: Model) -> None:
    """Raise DataError for the first record with an output of another size than the model says.

    Compared is the size of the measured and the simulated output in bands of frequency: refused is a ratio beyond
    FACTOR, up or down, on either side of which half of the energy of the motion lies.
    """
    plant = discretise(model.linear(), loaded.data.rate_hz)
    files = {source.run_uid: source.file for source in loaded.sources}
    for record in loaded.data.records:
        file, simulated = files[record.name], simulate(plant, record.u)
        for o, name in enumerate(port.name for port in model.outputs):
            bands = np.array(list(_ratios(simulated[:, o], record.y[:, o])))
            if len(bands) < _BANDS:
                continue
            middle = _middle(*bands.T)
            if max(middle, 1.0 / middle) > FACTOR:
                raise DataError(
                    f"{file}: output '{name}' moves {middle:.3g} times as much as the model says, where half of its "
                    f"motion is; causes are searched for up to a factor of {FACTOR:g}. Is it a record of another "
                    "bench, or is a unit or a channel wrong? `mccd log plot` shows it, `mccd identify` models it"
                )


def _level(x: Array) -> Array:
    """Return `x` (n,) without the straight line that fits it best."""
    along = np.arange(x.size) - 0.5 * (x.size - 1)
    return np.asarray(x - x.mean() - along * (along @ x) / (along @ along))


def _bands(lines: int) -> Iterator[slice]:
    """Yield the frequency bins of every third of an octave, `_LINES` or more of them."""
    edge = float(_LINES)
    while edge < lines - 1:
        stop = max(edge * _THIRD, edge + _LINES)
        yield slice(int(edge), min(int(stop), lines))
        edge = stop


def _middle(ratios: Array, energy: Array) -> float:
    """Return the ratio on either side of which half of the energy of the motion lies.

    In a loop the input answers the noise, and a simulation agrees with it in shape at any size: in most bands perhaps,
    but not in those of the motion.
    """
    order = np.argsort(ratios)
    below = np.cumsum(energy[order])
    return float(ratios[order][int(np.searchsorted(below, 0.5 * below[-1]))])


def _ratios(simulated: Array, measured: Array) -> Iterator[tuple[float, float]]:
    """Yield, for each band in which both agree in shape, how much more is measured than simulated, and its energy.

    Nothing where most of the motion is too slow for bands. Both are differenced twice, so that an offset or a drift of
    a free axis does not leak into every band. Only bands in which the output moves are tested: in a loop the input
    responds to the noise, and so agrees with it everywhere else.
    """
    a, b = (np.fft.rfft(np.diff(x, n=2) * np.hanning(x.size - 2)) for x in (simulated, measured))
    moved = np.abs(np.fft.rfft(_level(measured)[1:-1] * np.hanning(measured.size - 2))) ** 2
    bands = list(_bands(a.size))
    energy = np.array([np.sum(moved[band]) for band in bands])
    if energy.sum() < _SHOWN * moved.sum():
        return
    for band, own_energy in zip(bands, energy, strict=True):
        if own_energy < _MOVES * energy.max():
            continue
        own, other = float(np.sum(np.abs(a[band]) ** 2)), float(np.sum(np.abs(b[band]) ** 2))
        cross = abs(complex(np.vdot(a[band], b[band])))
        if own > 0.0 and other > 0.0 and cross**2 > _COHERENT * own * other:
            yield cross / own, own_energy
