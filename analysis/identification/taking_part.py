"""An identification of the channels that take part in it: the others stand in its model with gains of zero."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from analysis.identification.driven import answering, moving
from analysis.identification.held_out import channels_of
from analysis.identification.identified import Identification, sensor_zeros
from campaigns.log import LogSegment, Run
from sim_backend.linear import Array
from sim_backend.model import Port

Parts = Sequence[tuple[Run, LogSegment]]

MOST_ROWS = 50_000
"""Samples of a segment that are searched for an answer, where its inputs move most."""


@dataclass(frozen=True)
class TakingPart:
    """Segments to fit and all segments, of runs with only the channels that take part, and `remarks` on the others."""

    fitting: Parts
    parts: Parts
    remarks: tuple[str, ...]


def taking_part(fitting: Parts, parts: Parts) -> TakingPart:
    """Return the segments with the inputs that move in those to fit and the outputs that may answer them.

    With no input that moves, or no output that answers, all channels take part.
    """
    run = fitting[0][0]
    names = {role: np.array(run.names(role)) for role in ("input", "output")}
    u, y = zip(*(_searched(*part) for part in fitting), strict=True)
    moves = moving(u)
    if not moves.any():
        return TakingPart(fitting, parts, ())
    answers = answering([x[:, moves] for x in u], y, run.sample_rate_hz)
    if not answers.any():
        answers[:] = True
    left = {*names["input"][~moves].tolist(), *names["output"][~answers].tolist()}
    if not left:
        return TakingPart(fitting, parts, ())
    runs = {id(run): run.only([name for name in run.channels if name not in left]) for run, _ in (*fitting, *parts)}
    own = [[(runs[id(run)], s) for run, s in some] for some in (fitting, parts)]
    return TakingPart(own[0], own[1], _remarks(names["output"][~answers].tolist()))


def with_all_channels(
    found: Identification, inputs: Sequence[Port], outputs: Sequence[Port], fitting: Parts
) -> Identification:
    """Return an identification of some channels with all `inputs` and `outputs` in its model.

    Of an imported log the model has the mean of an output that took no part, as the zero of its sensor.
    """
    kept = {port.name for port in found.model.outputs}
    others = [port for port in outputs if port.name not in kept]
    effects = list(found.model.effects)
    if others and any(run.header.bench.get("kind") == "imported" for run, _ in fitting):
        means = [[run.read(port.name, s.start, s.stop).mean() for port in others] for run, s in fitting]
        uids = dict.fromkeys(run.run_uid for run, _ in fitting)
        effects += sensor_zeros(np.array(means), others, f"mean of run {', '.join(uids)}")
    whole = msgspec.structs.replace(found.model, inputs=list(inputs), outputs=list(outputs), effects=effects)
    return replace(found, model=whole)


def _searched(run: Run, segment: LogSegment) -> tuple[Array, Array]:
    """Return inputs (n, n_u) and outputs (n, n_y) of a segment, of a long one those where its inputs move most."""
    u = channels_of(run, segment, "input")
    start = 0
    if segment.rows > MOST_ROWS:
        size = u.std(axis=0)
        power = np.sum(((u - u.mean(axis=0)) / np.where(size > 0.0, size, 1.0)) ** 2, axis=1)
        total = np.concatenate([[0.0], np.cumsum(power)])
        start = int(np.argmax(total[MOST_ROWS:] - total[:-MOST_ROWS]))
    rows = slice(start, start + MOST_ROWS)
    some = replace(segment, start=segment.start + start, stop=min(segment.start + start + MOST_ROWS, segment.stop))
    return u[rows], channels_of(run, some, "output")


def _remarks(still: Sequence[str]) -> tuple[str, ...]:
    if not still:
        return ()
    one = len(still) == 1
    answers, it, its = (
        ("answers no input and holds", "it is", "its") if one else ("answer no input and hold", "they are", "their")
    )
    return (
        f"output {', '.join(still)} {answers} noise: {it} not fitted, {its} gains are written as zero, and errors are "
        "those of the other outputs",
    )
