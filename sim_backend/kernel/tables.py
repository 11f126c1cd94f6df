"""The tables of a run in the emitted loop: drawn numbers are read from them, what is kept is written to them.

A table has a row for every signal, as long as the run. Several benches side by side would touch a hundred rows in every
sample, more pages than a processor finds quickly: so some samples at a time are brought together, and what is kept is
handed back, row by row.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from sim_backend.kernel.code import F64, I64, Cells, Number, index, repeated
from sim_backend.kernel.emission import Emission

AT_ONCE = 256
"""Samples that are brought together: 25 signals of four benches take 0.2 MB, which stay in the processor's cache."""


class Tables:
    """Reads and writes the tables of a loop; `kept` has the number of rows of each output table."""

    def __init__(self, loop: Emission, kept: dict[str, int]) -> None:
        self._loop, self._rows = loop, kept
        self._staged = loop.structure.lanes > 1
        if self._staged:
            self._drawn = loop.local(AT_ONCE * loop.structure.n_columns, "drawn")
            self._out = {name: loop.local(AT_ONCE * rows, f"kept.{name}") for name, rows in kept.items()}

    def most(self, samples: Any) -> Any:
        """Return how many of `samples` can be played before `hand_back`."""
        return self._loop.least(samples, index(AT_ONCE)) if self._staged else samples

    def drawn(self, column: int, sample: Any, i: Any) -> Number:
        """Return the drawn number of `column` at `sample`, which is number `i` since `bring`."""
        at, loop = self._loop.at, self._loop
        if self._staged:
            return self._drawn[at.add(index(column * AT_ONCE), i)]
        return loop.cells("exogenous")[at.add(at.mul(index(column), loop.whole["n_drawn"]), sample)]

    def keep(self, name: str, row: int, sample: Any, i: Any, number: Number) -> None:
        """Store `number` in a row of the output table `name` at `sample`, which is number `i` since `bring`."""
        at, loop = self._loop.at, self._loop
        if self._staged:
            self._out[name][at.add(index(row * AT_ONCE), i)] = number
            return
        place = at.add(at.mul(index(row), loop.whole[f"columns.{name}"]), at.add(loop.whole["first"], sample))
        loop.cells(f"out.{name}")[place] = number

    def bring(self, sample: Any, count: Any) -> None:
        """Copy the drawn numbers of `count` samples, from `sample` on, to the working memory of the loop."""
        if not self._staged:
            return
        at, loop = self._loop.at, self._loop
        for column in range(loop.structure.n_columns):
            first = at.add(at.mul(index(column), loop.whole["n_drawn"]), sample)
            rows = [loop.cells_of(table, "exogenous").place(first) for table in loop.tables]
            at.call(self._moving("bring"), [self._drawn.place(column * AT_ONCE), *rows, count])

    def hand_back(self, sample: Any, count: Any) -> None:
        """Copy the outputs of `count` samples, from `sample` on, from the working memory to the output tables."""
        if not self._staged:
            return
        at, loop = self._loop.at, self._loop
        for name, rows in self._rows.items():
            columns = loop.whole[f"columns.{name}"]
            with at.if_then(at.icmp_signed(">", columns, index(0))):
                for row in range(rows):
                    first = at.add(at.mul(index(row), columns), at.add(loop.whole["first"], sample))
                    own = [loop.cells_of(table, f"out.{name}").place(first) for table in loop.tables]
                    at.call(self._moving("hand_back"), [self._out[name].place(row * AT_ONCE), *own, count])

    def _moving(self, name: str) -> Any:
        """Return the function that copies one row of every lane; arguments: working memory, a row per lane, samples."""
        module, lanes = self._loop.module, self._loop.structure.lanes
        if name in module.globals:
            return module.globals[name]
        given = [ir.VectorType(F64, lanes).as_pointer(), *[F64.as_pointer()] * lanes, I64]
        function = ir.Function(module, ir.FunctionType(ir.VoidType(), given), name)
        function.attributes.add("noinline")  # two dozen copies would take a compiler ten times as long
        at = ir.IRBuilder(function.append_basic_block("entry"))
        for argument in function.args[:-1]:
            argument.add_attribute("noalias")
        staged = Cells(at, at.bitcast(function.args[0], F64.as_pointer()))
        with repeated(at, function.args[-1], "row") as i:
            for lane, row in enumerate(function.args[1:-1]):
                here, own = at.add(at.mul(i, index(lanes)), index(lane)), Cells(at, row)
                if name == "bring":
                    staged[here] = own[i]
                else:
                    own[i] = staged[here]
        at.ret_void()
        return function
