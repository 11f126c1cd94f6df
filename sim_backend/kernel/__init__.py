"""The compiled time loop: emitted once for the structure of a bench, run for any numbers in it.

A loop calls the effects by the addresses of their compiled steps, so that a search over causes has one for all of
them. A bench that has been played for long gets one with its effects inlined (docs/decisions/0002), to the last bit the
same.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from sim_backend import layout
from sim_backend.kernel.arguments import entries, fixed_entries
from sim_backend.kernel.called import along
from sim_backend.kernel.machine import is_made, loop_of
from sim_backend.kernel.structure import NO_DELAY, Structure, structure_of

LONG = 2_000_000
"""Samples after which a bench gets a loop with its effects inlined: that takes about a second, and saves some 0.1 s per
million samples, of which there are more to come, here and in later processes."""

played: Counter[Structure] = Counter()
"""Samples that benches of a structure have played while no such loop was there."""


class Loop:
    """The loop of one bench with its controllers; its memory and the states of its effects go on from run to run.

    A `lasting` bench is one that will be played again: it gets a loop
    with its effects inlined in time.
    """

    def __init__(self, parts: layout.Parts, *, lasting: bool = False) -> None:
        self._parts = parts  # the table holds the addresses of their arrays: they must live as long
        self._called = structure_of(parts, inlined=False)
        self._inlined = structure_of(parts, inlined=True) if lasting else None
        self._fixed = fixed_entries(parts)
        self._steps = np.array([parts.plant.dt_s, parts.plant.dt_s / parts.plant.substeps])

    def play(self, n: int, wave: layout.Waveform, out: layout.Output) -> None:
        """Play `n` samples of `wave` and keep them in `out`."""
        table = np.array(self._fixed + entries(n, wave, self._parts.mem, out), dtype=np.int64)
        loop_of(self._structure(n))(table.ctypes.data, self._steps.ctypes.data)
        self._parts.mem.samples[0] += n

    def _structure(self, n: int) -> Structure:
        if self._inlined is None:
            return self._called
        if is_made(self._inlined):
            return self._inlined
        played[self._inlined] += n
        return self._inlined if played[self._inlined] > LONG else self._called


def contribution_along(
    fx: layout.Effects,
    e: int,
    signal: layout.Array,
    position: layout.Array,
    rate: layout.Array,
    aux: layout.Array,
    dt_s: float,
    out: layout.Array,
) -> None:
    """Fill `out` (n,) with what effect `e` adds along given signals, each (n,): its signature before the plant."""
    cell = fx.cells.ctypes.data
    own: list[Any] = [cell + 8 * i for i in range(5)]
    own += [fx.parameters.ctypes.data + 8 * fx.p0[e], fx.states.ctypes.data + 8 * fx.s0[e]]
    wires = np.array(own, dtype=np.int64)
    along(fx.address[e], wires, fx.cells, signal, position, rate, aux, dt_s, out)


__all__ = ["LONG", "NO_DELAY", "Loop", "contribution_along", "played"]
