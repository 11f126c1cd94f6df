"""What the parts of the time loop are emitted with: the function's arrays and numbers, and its signals by name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numpy.typing import NDArray

from sim_backend.kernel.arguments import BUS, COPIED, TABLE
from sim_backend.kernel.code import F64, I64, Cells, Number, SideBySide, Weights, index
from sim_backend.kernel.structure import ANY, Structure, whole
from sim_backend.machine_code import NAME


class Emission:
    """The LLVM code of a structure's function `play`, while it is generated.

    `play` takes the whole numbers and addresses of TABLE, one table per lane, and the time steps. `begin` creates
    `mine`, local copies of the COPIED arrays, and `bus`, the signals of one sample.
    """

    def __init__(self, structure: Structure) -> None:
        self.structure = structure
        self.module = ir.Module("loop")
        function = ir.Function(self.module, ir.FunctionType(ir.VoidType(), [I64.as_pointer(), F64.as_pointer()]), NAME)
        self.at = ir.IRBuilder(function.append_basic_block("entry"))
        given, width = function.args[0], len(TABLE)
        self.tables = [
            {name: self.at.load(self.at.gep(given, [index(lane * width + i)])) for i, name in enumerate(TABLE)}
            for lane in range(structure.lanes)
        ]
        self.whole = self.tables[0]  # the whole numbers, which all lanes share
        self.dt_s, self.fine_s = (self.alike(Cells(self.at, function.args[1])[i]) for i in (0, 1))
        kinds = structure.weights()
        self.weights = {name: self._weights(name, kinds[name]) for name in kinds}
        self.n_y, self.n_u = kinds["d"].shape
        self.n_a, self.n_s = kinds["to_current"].shape[0], kinds["to_heads"].shape[0]
        self.n_modes, self.n_blocks = kinds["a"].shape[0], kinds["fb"].shape[1]
        n_at, n_levers = kinds["coordinates"].shape[0], kinds["levers"].shape[0]
        # modes that effects may act on by themselves, beside the inputs
        self.n_pushed = kinds["levers"].shape[1] - self.n_u if n_levers else 0
        self.sizes = {
            "x": 2 * self.n_modes,
            "past": self.n_u + self.n_pushed,
            "acting": self.n_u,
            "xf": 2 * self.n_u * self.n_blocks,
            "parameters": structure.n_parameters,
            "states": structure.n_states,
        }
        self.bus_sizes = {
            "source": 2 + self.n_u + self.n_y + structure.n_columns,
            "driven": self.n_u,
            "current": self.n_a,
            "torque": self.n_u,
            "head": self.n_s,
            "reading": self.n_y,
            "at": n_at,
            "speed": structure.n_rates,
            "middle": structure.n_rates,
            "force": n_levers,
        }
        self.driven, self.driven_by, self.seen, self.seen_mode = (whole(part).tolist() for part in structure.plant)
        self.wires = structure.wires()
        self.wide_steps: dict[str, Any] = {}
        self.zero = self.constant(0.0)

    def constant(self, value: float) -> Number:
        """Return a number that is known, the same in all lanes."""
        return self.alike(Number(self.at, ir.Constant(F64, value)))

    def alike(self, number: Number) -> Number:
        """Return a number that is the same in all lanes."""
        return Number.of_lanes(self.at, [number.value] * self.structure.lanes)

    def cells(self, name: str) -> Cells:
        """Return an array of the table, of all lanes."""
        own = [self.cells_of(table, name) for table in self.tables]
        return own[0] if len(own) == 1 else SideBySide(self.at, own)

    def cells_of(self, table: dict[str, Any], name: str) -> Cells:
        """Return an array of one lane's table."""
        return Cells(self.at, self.at.inttoptr(table[name], F64.as_pointer()))

    def local(self, size: int, name: str, lanes: int = 0) -> Cells:
        """Return cells of the function's own, which the compiler keeps in registers where it can."""
        lanes = lanes or self.structure.lanes
        kind = F64 if lanes == 1 else ir.VectorType(F64, lanes)
        return Cells(self.at, self.at.alloca(kind, max(size, 1), name))

    def _weights(self, name: str, kinds: NDArray[np.uint8]) -> Weights:
        """Return an array of weights; those of several lanes are brought together first."""
        cells = self.cells(f"ctl.{name}" if name[0] == "f" else name)
        if self.structure.lanes > 1:
            together = self.local(kinds.size, name)
            for i in np.flatnonzero(kinds == ANY).tolist():
                together[i] = cells[i]
            cells = together
        return Weights(cells, kinds)

    def copy(self, source: Cells, target: Cells, size: int) -> None:
        """Copy `size` cells."""
        for i in range(size):
            target[i] = source[i]

    def begin(self) -> None:
        """Emit where the loop keeps what it goes on with; nothing is closed yet."""
        self.closed: list[Any] = []
        inlined = self.structure.inlined
        self.mine = {name: self.local(self.sizes[name], name) for name in COPIED}
        for name in COPIED:
            self.copy(self.cells(name), self.mine[name], self.sizes[name])
        # effects that are called by address find the signals in memory
        self.bus = {name: self.local(self.bus_sizes[name], name) if inlined else self.cells(name) for name in BUS}
        # through these cells effects and learning pass their numbers
        most = max(self.sizes["parameters"], self.sizes["states"])
        self.numbers_of_step = self.local(most, "own", lanes=1), self.local(most, "state", lanes=1)
        self.scratch = [self.local(2, "scratch", lanes=1) for _ in self.tables]

    def least(self, a: Any, b: Any) -> Any:
        """Return the lesser of two whole numbers."""
        return self.at.select(self.at.icmp_signed("<", a, b), a, b)

    def call(self, name: str, arguments: Sequence[Any], returns: Any = None) -> Any:
        """Emit a call of the compiled function whose address stands in the table."""
        kind = ir.FunctionType(returns or ir.VoidType(), [a.type for a in arguments])
        return self.at.call(self.at.inttoptr(self.whole[name], kind.as_pointer()), arguments)
