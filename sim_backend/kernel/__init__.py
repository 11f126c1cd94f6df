"""The compiled time loop: emitted once for the structure of a bench, run for any numbers in it.

A loop calls the effects by the addresses of their compiled steps, so that a search over causes has one for all of
them. A bench that is played for long gets one with its effects inlined (docs/decisions/0002), to the last bit the
same: from disk at once, or made in a thread while the other one plays.
"""

from __future__ import annotations

from collections import Counter
from typing import Any, NamedTuple

import numpy as np

from sim_backend import layout
from sim_backend.addresses import address_of_numbers
from sim_backend.kernel import machine
from sim_backend.kernel.arguments import entries, fixed_entries
from sim_backend.kernel.called import along
from sim_backend.kernel.structure import NO_DELAY, Structure, structure_of
from sim_backend.kernel.wires import wired

LONG = 200_000
"""Samples after which a bench gets a loop with its effects inlined: that takes a core about a second, aside, and saves
some 0.1 s per million samples, of which there are more to come, here and in later processes."""

LONG_REPLAYED = 40_000_000
"""Steps after which a bench of a search gets one. Nobody may ever play it again: it is made when the calls of effects,
at some 50 ns a step, have taken as long as that takes."""

played: Counter[Structure] = Counter()
"""Samples that benches of a structure have played while no such loop was there."""


class Structures(NamedTuple):
    """The structures of a bench's loops: the one that calls its effects, and the one with its effects inlined."""

    called: Structure
    inlined: Structure

    @classmethod
    def of(cls, parts: layout.Parts) -> Structures:
        """Return those of the bench with these arguments."""
        return cls(structure_of(parts, inlined=False), structure_of(parts, inlined=True))


class Loop:
    """The loop of one bench with its controllers; its memory and the states of its effects go on from run to run.

    A `lasting` bench is one that will be played again: it gets a loop with its effects inlined sooner than one of many
    that a search tries. `known` are its structures, if they are known: benches that differ in numbers alone have the
    same.
    """

    def __init__(self, parts: layout.Parts, known: Structures | None = None, *, lasting: bool = False) -> None:
        self.parts = parts  # the table holds the addresses of their arrays: they must live as long
        self.structures = known or Structures.of(parts)
        self._lasting = lasting
        machine.load(self.structures.inlined)
        self._steps = np.array([parts.plant.dt_s, parts.plant.dt_s / parts.plant.substeps])
        self._tables: dict[bool, tuple[list[int], tuple[layout.Ints, ...]]] = {}

    def play(self, n: int, wave: layout.Waveform, out: layout.Output) -> None:
        """Play `n` samples of `wave` and keep them in `out`."""
        structure = self._structure(n)
        self.run(structure, np.array(self.table(structure, n, wave, out), dtype=np.int64))
        self.parts.mem.samples[0] += n

    def structure(self) -> Structure:
        """Return the structure by which this loop is played beside others.

        A lasting bench has its effects inlined, and so has one of a search once it was played for long.
        """
        called, inlined = self.structures
        return inlined if self._lasting or machine.is_loaded(inlined) else called

    def table(self, structure: Structure, n: int, wave: layout.Waveform, out: layout.Output) -> list[int]:
        """Return what the emitted loop of a structure receives to play `n` samples of `wave`."""
        return self._table(structure.inlined)[0] + entries(n, wave, self.parts.mem, out)

    def run(self, structure: Structure, table: layout.Ints) -> None:
        """Run the loop of a structure with its table (lanes, k) of addresses."""
        machine.loop_of(structure)(address_of_numbers(table), address_of_numbers(self._steps))

    def _table(self, inlined: bool) -> tuple[list[int], tuple[layout.Ints, ...]]:
        """Return the part of a loop's table that stays, and arrays whose addresses it holds."""
        if inlined not in self._tables:
            parts, addresses = self.parts, np.zeros(0, dtype=np.int64)
            if not inlined:  # else nobody calls the steps, so they need not be compiled for that
                parts = parts._replace(fx=wired(parts.fx, parts.bus))
                addresses = np.array([machine.address_of(step) for step in parts.fx.steps], dtype=np.int64)
            self._tables[inlined] = fixed_entries(parts, addresses), (addresses, parts.fx.wires)
        return self._tables[inlined]

    def _structure(self, n: int) -> Structure:
        """Return the structure of the loop for the next `n` samples; see to it that later ones have effects inlined."""
        called, inlined = self.structures
        if machine.is_loaded(inlined):
            return inlined
        self.count(n)
        return called

    def count(self, n: int) -> None:
        """Note that `n` samples were played with calls of the effects; have them inlined, aside, when that pays."""
        inlined, substeps = self.structures.inlined, self.parts.plant.substeps
        played[inlined] += n
        if played[inlined] > (LONG if self._lasting else LONG_REPLAYED // substeps):
            machine.make_aside(inlined)


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
    cell = address_of_numbers(fx.cells)
    own: list[Any] = [cell + 8 * i for i in range(5)]
    own += [address_of_numbers(fx.parameters) + 8 * fx.p0[e], address_of_numbers(fx.states) + 8 * fx.s0[e]]
    wires = np.array(own, dtype=np.int64)
    along(machine.address_of(fx.steps[e]), wires, fx.cells, signal, position, rate, aux, dt_s, out)


__all__ = ["LONG", "LONG_REPLAYED", "NO_DELAY", "Loop", "Structures", "contribution_along", "played"]
