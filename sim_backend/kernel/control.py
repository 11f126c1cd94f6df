"""The part of the time loop that gives commands: feed-forward, feedback and learning of every axis."""

from __future__ import annotations

from typing import Any

from sim_backend.kernel.code import Cells, Number, added, index
from sim_backend.kernel.emission import Emission


def emit_commands(loop: Emission, sample: Any, k: Any) -> None:
    """Emit the commands of sample `k` of the period: feed-forward, feedback where the loop is closed, and learning."""
    reference, feedforward = (loop.cells_of(loop.whole, name) for name in ("reference", "feedforward"))
    row = loop.at.mul(k, index(loop.n_u))
    for i in range(loop.n_u):
        column, command = loop.at.add(row, index(i)), loop.bus["source"].part(2 + i)
        command[0] = loop.alike(feedforward[column])
        if loop.weights["fd"].kinds[i] or loop.weights["fb"].kinds[i].any():
            with loop.at.if_then(loop.closed[i], likely=True):
                command[0] = command[0] + _feedback(loop, i, loop.alike(reference[column]) - loop.bus["reading"][i])
        if loop.structure.learning[i]:
            _learn(loop, i, sample, loop.alike(reference[column]) - loop.bus["reading"][i], command)


def _feedback(loop: Emission, i: int, error: Number) -> Number:
    """Emit one sample of the block filter of an axis; return its output."""
    a, b, c, x = (
        loop.weights["fa"],
        loop.weights["fb"],
        loop.weights["fc"],
        loop.mine["xf"].part(2 * loop.n_blocks * i),
    )
    parts = []
    for m in range(loop.n_blocks):
        x0, x1 = x[2 * m], x[2 * m + 1]
        parts.append(c.term((i, m, 1), x1, c.term((i, m, 0), x0, None)))
        for state in (0, 1):
            kept = a.term((i, m, state, 1), x1, a.term((i, m, state, 0), x0, None))
            x[2 * m + state] = b.term((i, m, state), error, kept) or loop.zero
    return loop.weights["fd"].term((i,), error, added(parts)) or loop.zero


def _learn(loop: Emission, i: int, sample: Any, error: Number, command: Cells) -> None:
    """Emit the call that adds the repetitive input of an axis to its command."""
    now = loop.at.add(loop.whole["samples"], sample)
    of_controller = [f"ctl.{name}" for name in ("period", "lead", "learning", "taps", "gain", "la", "lb", "lc", "ld")]
    names = ["length", "n_taps", "n_blocks_l", *of_controller, "xl", "ring", "learned"]
    for lane, (table, scratch) in enumerate(zip(loop.tables, loop.scratch, strict=True)):
        scratch[0], scratch[1] = (Number(loop.at, number.lane(lane)) for number in (error, command[0]))
        loop.call("learn", [index(i), now, *(table[name] for name in names), scratch.place(0), scratch.place(1)])
    command[0] = Number.of_lanes(loop.at, [scratch[1].value for scratch in loop.scratch])
