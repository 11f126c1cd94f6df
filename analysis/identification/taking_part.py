"""An identification of the channels that take part in it: the others stand in its model with gains of zero."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from numpy.typing import NDArray

from analysis.identification.driven import answering
from analysis.identification.held_out import channels_of
from analysis.identification.identified import Identification, sensor_zeros
from analysis.recorded import folded
from campaigns.log import LogSegment, Run
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
    inputs, outputs = run.names("input"), run.names("output")
    surveys = [_survey(*part) for part in fitting]
    moves = np.any([moved for moved, _ in surveys], axis=0)
    if not moves.any():
        return TakingPart(fitting, parts, ())
    searched = [(run, some) for (run, _), (_, some) in zip(fitting, surveys, strict=True)]
    u, y = ([channels_of(run, some, role) for run, some in searched] for role in ("input", "output"))
    u = [x[:, moves] for x in u]
    seen = np.any([np.ptp(x, axis=0) > 0.0 for x in u], axis=0).all()
    answers = answering(u, y, run.sample_rate_hz) if seen else np.ones(len(outputs), dtype=bool)
    if not answers.any():
        answers[:] = True
    silent = [name for name, answer in zip(outputs, answers, strict=True) if not answer]
    left = {*silent, *(name for name, moved in zip(inputs, moves, strict=True) if not moved)}
    if not left:
        return TakingPart(fitting, parts, ())
    runs = {id(run): run.only([name for name in run.channels if name not in left]) for run, _ in (*fitting, *parts)}
    own = [[(runs[id(run)], s) for run, s in some] for some in (fitting, parts)]
    return TakingPart(own[0], own[1], _remarks(silent))


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
        means = [
            [run.read(port.name, s.start, s.stop).mean() for port in others] for run, s in folded.windowed(fitting)
        ]
        uids = dict.fromkeys(run.run_uid for run, _ in fitting)
        effects += sensor_zeros(np.array(means), others, f"mean of run {', '.join(uids)}")
    whole = msgspec.structs.replace(found.model, inputs=list(inputs), outputs=list(outputs), effects=effects)
    return replace(found, model=whole)


def _survey(run: Run, segment: LogSegment) -> tuple[NDArray[np.bool_], LogSegment]:
    """Return which inputs (n_u,) change in a segment, and of a long one the part in which they move most."""
    names = run.names("input")
    rows = max(min(MOST_ROWS, folded.BLOCK_VALUES // (len(names) + len(run.names("output")))), 1)
    first, starts, moves, power = None, [], np.zeros(len(names), dtype=bool), []
    for start, block in run.blocks(names, segment.start, segment.stop, rows):
        values = np.stack([block[name] for name in names], axis=1)
        first = values[0] if first is None else first
        moves |= np.any(values != first, axis=0)
        starts.append(start)
        power.append(values.var(axis=0) * values.shape[0])
    total = np.sum(power, axis=0)
    start = starts[int(np.argmax(np.sum(power / np.where(total > 0.0, total, 1.0), axis=1)))]
    return moves, replace(segment, start=start, stop=min(start + rows, segment.stop))


def _remarks(silent: Sequence[str]) -> tuple[str, ...]:
    if not silent:
        return ()
    names = ", ".join(silent)
    if len(silent) == 1:
        what, rest = f"output {names} answers no input and holds noise", "it is not fitted, its gains are"
    else:
        what, rest = f"outputs {names} answer no input and hold noise", "they are not fitted, their gains are"
    return (f"{what}: {rest} written as zero, and errors are those of the other outputs",)
