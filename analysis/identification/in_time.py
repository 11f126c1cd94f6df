"""Records of any waveform fitted in time: what is assumed of the plant, and how many modes are tried."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from analysis.identification.determined import without_undetermined
from analysis.identification.input_delay import fit_whole_delay, with_delay
from analysis.identification.loop_at_once import answers_at_once
from analysis.identification.modal_parameters import Structure
from analysis.identification.timefit import Compared, TimeFit, fit_records
from analysis.identification.whole_delay import freed
from campaigns.log import LogSegment, Run
from campaigns.progress import Report, part_of
from sim_backend.linear import Array, ModalModel

_SOME_ROWS = 20_000
"""Samples of the longest record that tell whether there is a loop: with feedthrough in one each order takes minutes."""


def fit_in_time(
    fitting: Sequence[tuple[Run, LogSegment]],
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    orders: tuple[int, ...],
    looped: bool,
    report: Report,
) -> TimeFit:
    """Return the fit to the inputs (n, n_u) and outputs (n, n_y) of all segments, by as many modes as they show.

    Without feedthrough where a loop answers at once, as a first fit tells (`looped`) or this one; with a delay where
    there is one.
    """
    rate = fitting[0][0].sample_rate_hz

    def fitted(structure: Structure, in_loop: bool, report: Report) -> TimeFit:
        def search(u: Sequence[Array], y: Sequence[Array]) -> TimeFit:
            return _fitted(u, y, rate, orders, structure, in_loop, part_of(report, 0.0, 0.9))

        if not may_be_late(fitting[0][0]):
            return search(inputs, outputs)
        fit = fit_whole_delay(search, inputs, outputs, rate, orders, structure)
        report(0.9, 1.0, "fitting a delay")
        return late_and_determined(fit, inputs, outputs, rate, orders, in_loop)

    # without feedthrough there is no second search
    fit = fitted(Structure(feedthrough=not looped), looped, part_of(report, 0.0, 1.0 if looped else 0.5))
    at_once = fit.model.delay_s * rate < 1.0
    # a first fit may miss too much to tell
    if np.any(fit.model.d[:, at_once]) and answers_at_once(fit, inputs, outputs):
        fit = fitted(Structure(feedthrough=False), True, part_of(report, 0.5, 1.0))
    return fit


def in_a_loop(inputs: Sequence[Array], outputs: Sequence[Array], rate_hz: float, blocks: int) -> bool:
    """Tell by a fit of so many blocks to some samples of the longest record whether a loop answers at once.

    Records are (n, n_u) and (n, n_y).
    """
    longest = max(range(len(inputs)), key=lambda i: inputs[i].shape[0])
    u, y = [inputs[longest][:_SOME_ROWS]], [outputs[longest][:_SOME_ROWS]]
    return answers_at_once(fit_records(u, y, rate_hz, blocks, rigid_bodies=None), u, y)


def _fitted(
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    rate: float,
    orders: tuple[int, ...],
    structure: Structure,
    in_loop: bool,
    report: Report,
) -> TimeFit:
    compared: dict[bytes, Compared] = {}
    fitted = partial(
        fit_records,
        inputs,
        outputs,
        rate,
        structure=structure,
        rigid_bodies=None,
        in_loop=in_loop,
        compared=compared,
    )

    fit = fitted(orders, report=part_of(report, 0.0, 0.6))
    most = fit.model.n_blocks

    def again(n: int, first: ModalModel | None) -> TimeFit:
        part_of(report, 0.6, 1.0)(float(most - 1 - n), float(most), "giving up modes that are not there")
        return fitted(n, start=first)

    return without_undetermined(fit, orders, again)


def late_and_determined(
    fit: TimeFit,
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    rate_hz: float,
    orders: tuple[int, ...],
    looped: bool = False,
) -> TimeFit:
    """Return `input_delay.with_delay` of a fit, and of one with a delay only the modes that are still determined.

    Shapes: every record's input (n, n_u) and output (n, n_y).
    """
    late = with_delay(fit, inputs, outputs, rate_hz)
    if np.array_equal(late.model.delay_s, fit.model.delay_s):
        return late
    return without_undetermined(late, orders, partial(fitted_again, late, inputs, outputs, rate_hz, looped), anew=False)


def fitted_again(
    fit: TimeFit,
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    rate_hz: float,
    looped: bool,
    blocks: int,
    start: ModalModel | None,
) -> TimeFit:
    """Return a fit of so many blocks from `start`, with the structure and the whole samples of delay that `fit` has.

    Shapes: every record's input (n, n_u) and output (n, n_y).
    """
    whole = np.floor(fit.model.delay_s * rate_hz + 1e-6).astype(np.intp)
    records = freed(inputs, outputs, whole, int(whole.max(initial=0)))
    first = None if start is None else start.with_(delay_s=fit.model.delay_s - whole / rate_hz)
    found = fit_records(
        *records, rate_hz, blocks, structure=fit.structure, rigid_bodies=None, start=first, in_loop=looped
    )
    return replace(found, model=found.model.with_(delay_s=found.model.delay_s + whole / rate_hz))


def may_be_late(run: Run) -> bool:
    """Tell whether the inputs of a run may act late: no bench of our own has a delay."""
    return bool(run.header.bench.get("kind") == "imported")
