"""The step of an effect for several benches at once, from the same Python as the step for one.

Where benches go different ways at an `if`, those that go there are marked by a mask, the others keep what they have;
a way that nobody goes is skipped. Every operation is the one that numba makes of the same expression, so each bench
gets the bits that it would get alone. A step that holds what is not known here is called for one bench after the other.
"""

from __future__ import annotations

import ast
import inspect
import math
import operator
import textwrap
from collections.abc import Sequence
from typing import Any

from llvmlite import ir

from sim_backend.effects.compiled import Step
from sim_backend.kernel.code import F64, Cells, Number

ALONE: dict[Any, str] = {math.tanh: "tanh", math.expm1: "expm1", math.exp: "llvm.exp.f64"}
"""Functions that are called for one bench after the other, as numba calls them."""

TOGETHER: dict[Any, str] = {math.sqrt: "llvm.sqrt", math.ceil: "llvm.ceil", math.floor: "llvm.floor", abs: "llvm.fabs"}
"""Functions whose result is exact, or rounded right."""

Known = float | int
"""What is known while the step is written."""

_BUILT_IN = {"abs": abs, "min": min, "max": max}
_RETURNED = "return"
_ARITHMETIC: dict[type, Any] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_COMPARISONS: dict[type, tuple[str, Any]] = {
    ast.Lt: ("<", operator.lt),
    ast.Gt: (">", operator.gt),
    ast.LtE: ("<=", operator.le),
    ast.GtE: (">=", operator.ge),
    ast.Eq: ("==", operator.eq),
    ast.NotEq: ("!=", operator.ne),
}


class _UnknownError(Exception):
    """A step holds what is not known here."""


def wide_step(module: ir.Module, name: str, step: Step, lanes: int) -> Any:
    """Return the step for several lanes as a function of the module, None where it holds what is not known.

    It takes what the step for one takes, signals as vectors and addresses of vectors.
    """
    wide = ir.VectorType(F64, lanes)
    kind = ir.FunctionType(wide, [wide] * 5 + [wide.as_pointer()] * 2)
    for place in (ir.Module("trial"), module):  # what fails leaves nothing behind
        function = ir.Function(place, kind, name)
        try:
            _Writer(function, step).write()
        except _UnknownError:
            return None
    return function


class _Writer:
    """Writes one function: statements change variables, under the mask of the lanes that are there (None: all)."""

    def __init__(self, function: ir.Function, step: Step) -> None:
        python: Any = step.__wrapped__  # type: ignore[attr-defined]
        (definition,) = ast.parse(textwrap.dedent(inspect.getsource(python))).body
        assert isinstance(definition, ast.FunctionDef)
        self._body, self._globals = definition.body, python.__globals__
        self._wide, self._module = function.function_type.return_type, function.module
        self._entry, rest = function.append_basic_block("entry"), function.append_basic_block("rest")
        self._at = ir.IRBuilder(self._entry)
        self._at.branch(rest)
        self._at.position_at_end(rest)
        names = [argument.arg for argument in definition.args.args]
        self._arrays = {n: Cells(self._at, a) for n, a in zip(names[5:], function.args[5:], strict=True)}
        self._known: dict[str, Known] = {}
        self._variables: dict[str, Any] = {}
        for own, argument in zip(names[:5], function.args[:5], strict=True):
            self._keep(own, Number(self._at, argument), None)

    def write(self) -> None:
        """Write the whole step."""
        if not self._statements(self._body, None):
            raise _UnknownError
        self._at.ret(self._at.load(self._variables[_RETURNED]))

    def _statements(self, body: Sequence[ast.stmt], mask: Any) -> bool:
        """Write statements; tell whether they end with what the step returns."""
        for i, one in enumerate(body):
            if isinstance(one, ast.Return) and one.value is not None:
                self._keep(_RETURNED, self._value(one.value), mask)
                return True
            if isinstance(one, ast.If):
                left = self._branch(one, mask)
                if left is not mask:  # some have returned: what follows is for the others
                    with self._at.if_then(self._any(left)):
                        return self._statements(body[i + 1 :], left)
            elif isinstance(one, ast.For):
                self._repeat(one, mask)
            elif isinstance(one, ast.Assign) and len(one.targets) == 1:
                self._assign(one.targets[0], one.value, mask)
            elif isinstance(one, ast.AugAssign):
                self._assign(one.target, ast.BinOp(one.target, one.op, one.value), mask)
            else:
                raise _UnknownError
        return False

    def _branch(self, one: ast.If, mask: Any) -> Any:
        """Write both ways of an `if`; return the mask of those that have not returned there."""
        test = self._value(one.test)
        if isinstance(test, bool):  # known while it is written
            if self._statements(one.body if test else one.orelse, mask):
                raise _UnknownError
            return mask
        yes, no = self._both(mask, self._truth(test)), self._both(mask, self._at.not_(self._truth(test)))
        with self._at.if_then(self._any(yes)):
            returned = self._statements(one.body, yes)
        if one.orelse:
            with self._at.if_then(self._any(no)):
                if self._statements(one.orelse, no):
                    raise _UnknownError
        return no if returned else mask

    def _repeat(self, one: ast.For, mask: Any) -> None:
        """Write a loop over `range(n)`: written n times where n is known, else until no lane is left."""
        call = one.iter
        if not (isinstance(call, ast.Call) and ast.unparse(call.func) == "range" and len(call.args) == 1):
            raise _UnknownError
        if one.orelse or not isinstance(one.target, ast.Name):
            raise _UnknownError
        count = self._value(call.args[0])
        if isinstance(count, int):
            for self._known[one.target.id] in range(count):
                if self._statements(one.body, mask):
                    raise _UnknownError
            return
        if one.target.id != "_":
            raise _UnknownError
        head, body, end = (self._at.append_basic_block(name) for name in ("again", "turn", "over"))
        self._keep(f"{id(one)}", 0.0, None)
        self._at.branch(head)
        self._at.position_at_end(head)
        done = Number(self._at, self._at.load(self._variables[f"{id(one)}"]))
        left = self._both(mask, self._at.fcmp_ordered("<", done.value, self._number(count).value))
        self._at.cbranch(self._any(left), body, end)
        self._at.position_at_end(body)
        if self._statements(one.body, left):
            raise _UnknownError
        self._keep(f"{id(one)}", done + 1.0, None)
        self._at.branch(head)
        self._at.position_at_end(end)

    def _assign(self, target: ast.expr, value: ast.expr, mask: Any) -> None:
        """Write an assignment, of several at once too."""
        if not isinstance(target, ast.Tuple):
            self._set(target, self._value(value), mask)
            return
        found = self._several(value)
        for one, own in zip(target.elts, found, strict=True):
            self._set(one, own, mask)

    def _several(self, value: ast.expr) -> list[Any]:
        if isinstance(value, ast.Tuple):
            return [self._value(one) for one in value.elts]
        if isinstance(value, ast.IfExp):
            test = self._value(value.test)
            ways = zip(self._several(value.body), self._several(value.orelse), strict=True)
            return [self._chosen(test, yes, no) for yes, no in ways]
        raise _UnknownError

    def _set(self, target: ast.expr, value: Any, mask: Any) -> None:
        if isinstance(target, ast.Name):
            self._known.pop(target.id, None)
            self._keep(target.id, value, mask)
            return
        cells, i = self._cell(target)
        number = self._number(value)
        cells[i] = number if mask is None else Number(self._at, self._at.select(mask, number.value, cells[i].value))

    def _keep(self, name: str, value: Any, mask: Any) -> None:
        """Write a variable; lanes that are not there keep what they have."""
        raw = value if isinstance(value, ir.Value) else self._number(value).value
        if name not in self._variables:
            with self._at.goto_block(self._entry):  # zero: what no lane has written decides nothing
                place = self._variables[name] = self._at.alloca(raw.type)
                self._at.store(ir.Constant(raw.type, 0.0 if raw.type == self._wide else 0), place)
        place = self._variables[name]
        if place.type.pointee != raw.type:
            raise _UnknownError
        self._at.store(raw if mask is None else self._at.select(mask, raw, self._at.load(place)), place)

    def _value(self, node: ast.expr) -> Any:
        """Write an expression; return a Number, the yes or no of every lane, or what is known while it is written."""
        written = {
            ast.Constant: self._constant,
            ast.Name: self._name,
            ast.Attribute: self._name,
            ast.Subscript: self._element,
            ast.BinOp: self._arithmetic,
            ast.UnaryOp: self._sign,
            ast.Compare: self._comparison,
            ast.BoolOp: self._logic,
            ast.IfExp: self._conditional,
            ast.Call: self._call,
        }.get(type(node))
        if written is None:
            raise _UnknownError
        return written(node)

    def _constant(self, node: Any) -> Any:
        if not isinstance(node.value, Known):
            raise _UnknownError
        return node.value

    def _name(self, node: Any) -> Any:
        name = ast.unparse(node)
        if name in self._known:
            return self._known[name]
        if name in self._variables:
            raw = self._at.load(self._variables[name])
            return Number(self._at, raw) if raw.type == self._wide else raw
        found = self._from_outside(node)
        if not isinstance(found, Known):
            raise _UnknownError
        return found

    def _from_outside(self, node: ast.expr) -> Any:
        """Return what a name outside of the step stands for."""
        if isinstance(node, ast.Attribute):
            return getattr(self._from_outside(node.value), node.attr, None)
        if not isinstance(node, ast.Name):
            raise _UnknownError
        return self._globals.get(node.id, _BUILT_IN.get(node.id))

    def _cell(self, node: Any) -> tuple[Cells, int]:
        i = self._value(node.slice) if isinstance(node, ast.Subscript) else None
        cells = self._arrays.get(ast.unparse(node.value)) if isinstance(i, int) else None
        if cells is None or i is None:
            raise _UnknownError
        return cells, i

    def _element(self, node: Any) -> Number:
        cells, i = self._cell(node)
        return cells[i]

    def _arithmetic(self, node: Any) -> Any:
        left, right = self._value(node.left), self._value(node.right)
        if isinstance(node.op, ast.Pow):
            return self._power(left, right)
        act = _ARITHMETIC.get(type(node.op))
        if act is None:
            raise _UnknownError
        if isinstance(left, Known) and isinstance(right, Known):
            return act(left, right)
        return act(self._number(left), self._number(right))

    def _power(self, base: Any, exponent: Any) -> Any:
        """Write a whole power by squaring, in numba's order."""
        if not isinstance(base, Number) or not isinstance(exponent, int) or exponent < 1:
            raise _UnknownError
        out: Number | None = None
        while exponent:
            if exponent & 1:
                out = base if out is None else out * base
            exponent >>= 1
            base = base * base if exponent else base
        return out

    def _sign(self, node: Any) -> Any:
        value = self._value(node.operand)
        if isinstance(node.op, ast.Not):
            return not value if isinstance(value, bool) else self._at.not_(self._truth(value))
        if not isinstance(node.op, ast.USub):
            raise _UnknownError
        return -value if isinstance(value, Known) else Number(self._at, self._at.fneg(self._number(value).value))

    def _comparison(self, node: Any) -> Any:
        if len(node.ops) != 1 or type(node.ops[0]) not in _COMPARISONS:
            raise _UnknownError
        left, right = self._value(node.left), self._value(node.comparators[0])
        sign, act = _COMPARISONS[type(node.ops[0])]
        if isinstance(left, Known) and isinstance(right, Known):
            return act(left, right)
        if isinstance(left, ir.Value) and isinstance(right, ir.Value):
            return self._at.icmp_signed(sign, left, right)
        compare = self._at.fcmp_unordered if sign == "!=" else self._at.fcmp_ordered
        return compare(sign, self._number(left).value, self._number(right).value)

    def _logic(self, node: Any) -> Any:
        join = self._at.and_ if isinstance(node.op, ast.And) else self._at.or_
        first, *others = [self._truth(self._value(one)) for one in node.values]
        for one in others:
            first = join(first, one)
        return first

    def _conditional(self, node: Any) -> Any:
        return self._chosen(self._value(node.test), self._value(node.body), self._value(node.orelse))

    def _chosen(self, test: Any, yes: Any, no: Any) -> Any:
        """Write a choice between two values, both of which are there."""
        if isinstance(test, bool):
            return yes if test else no
        return Number(self._at, self._at.select(self._truth(test), self._number(yes).value, self._number(no).value))

    def _call(self, node: Any) -> Any:
        function, values = self._from_outside(node.func), [self._number(self._value(one)) for one in node.args]
        if function in (min, max) and len(values) == 2:
            first, second = values  # the second where it is beyond the first
            beyond = self._at.fcmp_ordered("<" if function is min else ">", second.value, first.value)
            return Number(self._at, self._at.select(beyond, second.value, first.value))
        if function in TOGETHER and len(values) == 1:
            kind = self._declared(f"{TOGETHER[function]}.v{self._wide.count}f64", self._wide)
            return Number(self._at, self._at.call(kind, [values[0].value]))
        if function in ALONE and len(values) == 1:
            kind = self._declared(ALONE[function], F64)
            lanes = [self._at.call(kind, [values[0].lane(lane)]) for lane in range(self._wide.count)]
            return Number.of_lanes(self._at, lanes)
        raise _UnknownError

    def _declared(self, name: str, kind: Any) -> Any:
        return self._module.globals.get(name) or ir.Function(self._module, ir.FunctionType(kind, [kind]), name)

    def _number(self, value: Any) -> Number:
        if isinstance(value, Number):
            return value
        if isinstance(value, bool) or not isinstance(value, Known):
            raise _UnknownError
        return Number(self._at, ir.Constant(self._wide, float(value)))

    def _truth(self, value: Any) -> Any:
        if not isinstance(value, ir.Value):
            raise _UnknownError
        return value

    def _both(self, mask: Any, truth: Any) -> Any:
        return truth if mask is None else self._at.and_(mask, truth)

    def _any(self, mask: Any) -> Any:
        """Return whether any lane is there."""
        whole = ir.IntType(self._wide.count)
        return self._at.icmp_signed("!=", self._at.bitcast(mask, whole), ir.Constant(whole, 0))
