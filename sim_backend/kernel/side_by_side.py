"""Benches of one structure played side by side, one in each lane of a loop: the same bits as each alone, in less time.

They share the whole numbers of the loop (what is played, for how long, when gates open), and differ in the numbers of
their arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim_backend import layout
from sim_backend.kernel import Loop, machine, played
from sim_backend.kernel.arguments import TABLE
from sim_backend.kernel.structure import LANES, Structure

LONG_SIDE_BY_SIDE = 2_000_000
"""Samples after which benches get a loop for several: making it takes a core some seconds, aside."""

WORTH_CALLING = 4
"""Steps to a sample from which lanes save time where effects are called, one lane after the other: what is shared is
then more than what it takes to hand signals over. Measured on three modes with one or two effects, as parts of the time
alone: 1.3 to 1.8 at one step, 0.7 to 1.2 at four, 0.5 to 0.9 at sixteen."""

_SHARED = [
    i
    for i, name in enumerate(TABLE)
    if name in ("reference", "feedforward", "events", "n", "samples", "first", "period", "n_events", "n_drawn")
    or name in ("substeps", "depth", "n_blocks", "n_blocks_l", "n_taps", "length")
    or name.startswith("columns.")
]
"""Entries of the table of which the loop reads those of the first lane alone."""


def play(loops: Sequence[Loop], n: int, waves: Sequence[layout.Waveform], outs: Sequence[layout.Output]) -> None:
    """Play `n` samples of every loop's wave and keep them in its output, as `Loop.play` does one by one.

    As many as there are lanes go together, where they can.
    """
    for first in range(0, len(loops), LANES):
        part = slice(first, first + LANES)
        if not _played_together(loops[part], n, waves[part], outs[part]):
            for loop, wave, out in zip(loops[part], waves[part], outs[part], strict=True):
                loop.play(n, wave, out)


def _played_together(
    loops: Sequence[Loop], n: int, waves: Sequence[layout.Waveform], outs: Sequence[layout.Output]
) -> bool:
    """Play these loops together, if there are enough, they are alike, and there is a loop for that."""
    structure, substeps = loops[0].structure(), loops[0].parts.plant.substeps
    if len(loops) < LANES or any(loop.structure() != structure for loop in loops):
        return False
    if not structure.inlined and substeps < WORTH_CALLING:
        return False
    together = replace(structure, lanes=LANES)
    if not _is_there(loops[0], together, n) or not _alike([loop.parts for loop in loops]):
        return False
    rows = [loop.table(structure, n, wave, out) for loop, wave, out in zip(loops, waves, outs, strict=True)]
    table = np.array(rows, dtype=np.int64)
    if np.any(table[:, _SHARED] != table[0, _SHARED]):
        return False
    loops[0].run(together, table)
    for loop in loops:
        loop.parts.mem.samples[0] += n
        if not structure.inlined:
            loop.count(n)
    return True


def _is_there(loop: Loop, together: Structure, n: int) -> bool:
    """Tell whether the loop for several is ready; see to it that it will be where they are played for long."""
    if machine.load(together):
        return True
    played[together] += LANES * n
    if played[together] > LONG_SIDE_BY_SIDE:
        machine.make_aside(together)
    return False


def _alike(parts: Sequence[layout.Parts]) -> bool:
    """Tell whether what the loop decides on is the same for all: open and closed loops, and delays in whole samples."""
    first = parts[0]
    return all(
        np.array_equal(one.mem.closed, first.mem.closed)
        and np.array_equal(one.mem.has_past, first.mem.has_past)
        and np.array_equal(one.plant.delay_first, first.plant.delay_first)
        and one.plant.dt_s == first.plant.dt_s
        for one in parts[1:]
    )
