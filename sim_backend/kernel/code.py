"""Arithmetic that is written down instead of done: numbers that stand for values of a function being emitted.

The time loop is emitted for one structure of a bench (`sim_backend.kernel.sample`), so that its loops over modes and
axes are loops of Python, and the remainder is straight code of additions and multiplications.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from llvmlite import ir
from numpy.typing import NDArray

from sim_backend.kernel.structure import ONE, ZERO

F64, I32, I64 = ir.DoubleType(), ir.IntType(32), ir.IntType(64)


class Number:
    """A float64 of the emitted function, or one for each lane; its operators emit instructions."""

    def __init__(self, at: ir.IRBuilder, value: Any) -> None:
        self.at, self.value = at, value

    def _operand(self, other: Number | float) -> Any:
        return other.value if isinstance(other, Number) else ir.Constant(self.value.type, float(other))

    def __add__(self, other: Number | float) -> Number:
        return Number(self.at, self.at.fadd(self.value, self._operand(other)))

    def __sub__(self, other: Number | float) -> Number:
        return Number(self.at, self.at.fsub(self.value, self._operand(other)))

    def __mul__(self, other: Number | float) -> Number:
        return Number(self.at, self.at.fmul(self.value, self._operand(other)))

    def __truediv__(self, other: Number | float) -> Number:
        return Number(self.at, self.at.fdiv(self.value, self._operand(other)))

    def times_plus(self, factor: Number, addend: Number) -> Number:
        """Return self · factor + addend, rounded once: the same on every processor."""
        kind = self.value.type
        name = f"llvm.fma.v{kind.count}f64" if isinstance(kind, ir.VectorType) else "llvm.fma.f64"
        known = self.at.module.globals.get(name)
        function = known or ir.Function(self.at.module, ir.FunctionType(kind, [kind] * 3), name)
        return Number(self.at, self.at.call(function, [self.value, factor.value, addend.value]))

    def lane(self, lane: int) -> Any:
        """Return the value of one lane."""
        return self.at.extract_element(self.value, ir.Constant(I32, lane)) if self.lanes > 1 else self.value

    def with_lane(self, lane: int, value: Any) -> Number:
        """Return the number with the value of one lane replaced."""
        return Number(self.at, self.at.insert_element(self.value, value, ir.Constant(I32, lane)))

    @property
    def lanes(self) -> int:
        """How many numbers it holds."""
        return self.value.type.count if isinstance(self.value.type, ir.VectorType) else 1

    @classmethod
    def of_lanes(cls, at: ir.IRBuilder, values: Sequence[Any]) -> Number:
        """Return the number with one value for each lane."""
        if len(values) == 1:
            return cls(at, values[0])
        value: Any = ir.Constant(ir.VectorType(F64, len(values)), ir.Undefined)
        for lane, one in enumerate(values):
            value = at.insert_element(value, one, ir.Constant(I32, lane))
        return cls(at, value)


class Cells:
    """Consecutive numbers in memory, read and written by index: a Python int or an emitted whole number."""

    def __init__(self, at: ir.IRBuilder, pointer: Any) -> None:
        self.at, self.pointer = at, pointer

    def place(self, i: Any) -> Any:
        """Return the address of cell `i`."""
        return self.at.gep(self.pointer, [index(i) if isinstance(i, int) else i])

    def __getitem__(self, i: Any) -> Number:
        return Number(self.at, self.at.load(self.place(i)))

    def __setitem__(self, i: Any, number: Number) -> None:
        self.at.store(number.value, self.place(i))

    def part(self, first: Any) -> Cells:
        """Return the cells from `first` on."""
        return Cells(self.at, self.place(first))


class SideBySide(Cells):
    """The same cells of several benches: a number holds what each of them has there."""

    def __init__(self, at: ir.IRBuilder, lanes: Sequence[Cells]) -> None:
        super().__init__(at, None)
        self.lanes = lanes

    def place(self, i: Any) -> Any:
        """Raise TypeError: they have no address in common."""
        raise TypeError("cells of several benches have no address in common")

    def __getitem__(self, i: Any) -> Number:
        return Number.of_lanes(self.at, [cells[i].value for cells in self.lanes])

    def __setitem__(self, i: Any, number: Number) -> None:
        for lane, cells in enumerate(self.lanes):
            cells[i] = Number(self.at, number.lane(lane))

    def part(self, first: Any) -> Cells:
        """Return the cells from `first` on."""
        return SideBySide(self.at, [cells.part(first) for cells in self.lanes])


class Weights:
    """An array of weights in memory, of which the structure knows zeros and ones: `kinds`, of the array's shape."""

    def __init__(self, cells: Cells, kinds: NDArray[np.uint8]) -> None:
        self.cells, self.kinds, self.shape = cells, kinds, kinds.shape

    def term(self, where: tuple[int, ...], value: Number, total: Number | None) -> Number | None:
        """Return total + weight · value; None stands for nothing, which is zero."""
        kind = self.kinds[where]
        if kind == ZERO:
            return total
        if kind == ONE:
            return value if total is None else total + value
        weight = self.cells[int(np.ravel_multi_index(where, self.shape))]
        return weight * value if total is None else weight.times_plus(value, total)

    def row(self, i: int, values: Sequence[Number], total: Number | None = None) -> Number | None:
        """Return total + row `i` of a matrix times `values`."""
        for j, value in enumerate(values):
            total = self.term((i, j), value, total)
        return total


def added(parts: Sequence[Number | None]) -> Number | None:
    """Return the sum of what there is, in pairs, so that no addition waits for more than a few others."""
    terms = [p for p in parts if p is not None]
    while len(terms) > 1:
        terms = [a + b for a, b in zip(terms[::2], terms[1::2], strict=False)] + terms[len(terms) // 2 * 2 :]
    return terms[0] if terms else None


def index(i: int) -> ir.Constant:
    """Return a whole number of the emitted function."""
    return ir.Constant(I64, i)


@contextmanager
def repeated(at: ir.IRBuilder, count: Any, name: str) -> Iterator[Any]:
    """Emit what stands inside `count` times; gives the number of the pass, an emitted whole number."""
    before = at.block
    body, after = at.append_basic_block(name), at.append_basic_block(f"{name}.done")
    at.cbranch(at.icmp_signed(">", count, index(0)), body, after)
    at.position_at_end(body)
    number = at.phi(I64, name)
    number.add_incoming(index(0), before)
    yield number
    following = at.add(number, index(1))
    number.add_incoming(following, at.block)
    at.cbranch(at.icmp_signed("<", following, count), body, after)
    at.position_at_end(after)
