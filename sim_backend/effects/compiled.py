"""How the step of an effect becomes machine code: a loop over all its places, called once per sample.

A bench holds the same effect at several places (noise of three amplifiers, the iron of two axes), so one call serves
all of them, with the step inlined: signals that a step does not use are not even read.
"""

from __future__ import annotations

import dis
import types as python
from collections.abc import Callable
from functools import cache
from typing import Any
from zlib import crc32

from llvmlite import ir
from numba import cfunc, extending, njit, types

WIRES = 7
"""Addresses of one place: signal, position, rate, aux, target, parameters, state."""

intrinsic: Any = extending.intrinsic  # what it makes is called without the first argument, which its types do not know

_LOOP = types.void(types.intp, types.CPointer(types.intp), types.float64)


@intrinsic
def load(typingctx, address):  # type: ignore[no-untyped-def]
    """Return the float64 at an address."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.load(builder.inttoptr(args[0], ir.DoubleType().as_pointer()))

    return types.float64(types.intp), codegen


@intrinsic
def store(typingctx, address, value):  # type: ignore[no-untyped-def]
    """Write a float64 to an address."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        builder.store(args[1], builder.inttoptr(args[0], ir.DoubleType().as_pointer()))
        return context.get_dummy_value()

    return types.void(types.intp, types.float64), codegen


@intrinsic
def _numbers(typingctx, address):  # type: ignore[no-untyped-def]
    """Return an address as a pointer to float64 numbers."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.inttoptr(args[0], ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(types.intp), codegen


@intrinsic
def call_loop(typingctx, address, n, wires, dt_s):  # type: ignore[no-untyped-def]
    """Call the compiled loop at `address` for `n` places, whose addresses begin at the address `wires`."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        whole = args[1].type
        function = ir.FunctionType(ir.VoidType(), [whole, whole.as_pointer(), ir.DoubleType()])
        callee = builder.inttoptr(args[0], function.as_pointer())
        builder.call(callee, [args[1], builder.inttoptr(args[2], whole.as_pointer()), args[3]])
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, types.intp, types.float64), codegen


def _loop(n, wires, dt_s):  # type: ignore[no-untyped-def]
    for i in range(0, WIRES * n, WIRES):
        signal, position, rate, aux = load(wires[i]), load(wires[i + 1]), load(wires[i + 2]), load(wires[i + 3])
        target = wires[i + 4]
        added = _step(signal, position, rate, aux, dt_s, _numbers(wires[i + 5]), _numbers(wires[i + 6]))  # type: ignore[name-defined] # noqa: F821
        store(target, load(target) + added)


def compiled(step: Callable[..., float]) -> Any:
    """Compile `step`(signal, position, rate, aux, dt_s, parameters, state) -> contribution into a loop over its places.

    `signal` is the value at the effect's place before it (command, current, torque, sensor, reading), `position` and
    `rate` the motion of its coordinate, `aux` the value of its auxiliary source (see Aux) and `dt_s` the time step.
    `parameters` and `state` are pointers to this place's own numbers. The Python function stays as `__wrapped__`.
    """
    # a loop of the step's own, in its file's name: numba keeps the machine code until that file changes. The checksum
    # is that of the loop above, which is in another file
    code = _loop.__code__.replace(co_filename=step.__code__.co_filename, co_firstlineno=step.__code__.co_firstlineno)
    names = {**globals(), "_step": njit(forceinline=True, error_model="numpy")(step), "__name__": step.__module__}
    loop = python.FunctionType(code, names, step.__name__)
    loop.__qualname__ = f"{step.__qualname__}_{crc32(_loop.__code__.co_code):08x}"
    made: Any = cfunc(_LOOP, cache=True, forceinline=True, error_model="numpy")(loop)
    made.__wrapped__ = step
    made.key = f"{step.__module__}.{step.__qualname__}.{_checksum(step.__code__)}"
    return made


def _checksum(code: python.CodeType) -> str:
    return f"{crc32(repr((code.co_code, code.co_consts, code.co_names)).encode()):08x}"


def plain(made: Any) -> tuple[str, str]:
    """Return a compiled step alone, for one place, as LLVM's text and the name of its function.

    It takes signal, position, rate, aux and dt_s as float64, then the addresses of parameters and state.
    """
    numbers = types.CPointer(types.float64)
    signature = types.float64(*[types.float64] * 5, numbers, numbers)
    alone: Any = cfunc(signature, error_model="numpy")(made.__wrapped__)
    # numba forbids to inline what it wraps for callers in C
    return alone.inspect_llvm().replace("noinline", "alwaysinline"), alone.native_name


@cache
def reads(made: Any, argument: str) -> bool:
    """Tell whether a compiled step looks at one of its arguments, by name."""
    loaded = (i.argval for i in dis.get_instructions(made.__wrapped__) if i.opname.startswith("LOAD_FAST"))
    return any(argument in (names if isinstance(names, tuple) else (names,)) for names in loaded)
