"""The step of an effect: Python that numba translates to LLVM's text, of which the kernel makes machine code.

Nothing is translated before a bench is played; the text is kept on disk.
"""

from __future__ import annotations

import dis
import json
from collections.abc import Callable
from functools import cached_property, update_wrapper
from types import CodeType
from typing import Any, cast
from zlib import crc32

from sim_backend.jit import Callback, entry_name, intrinsic
from sim_backend.kernel_cache import keep_entry, read_entry

WIRES = 7
"""Addresses at one location: signal, position, rate, aux, target, parameters, state."""

_ALONE = f"float64({'float64, ' * 5}CPointer(float64), CPointer(float64))"


@intrinsic
def load(typingctx, address):  # type: ignore[no-untyped-def]
    """Return the float64 at an address."""
    from llvmlite import ir
    from numba import types

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.load(builder.inttoptr(args[0], ir.DoubleType().as_pointer()))

    return types.float64(types.intp), codegen


@intrinsic
def store(typingctx, address, value):  # type: ignore[no-untyped-def]
    """Write a float64 to an address."""
    from llvmlite import ir
    from numba import types

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        builder.store(args[1], builder.inttoptr(args[0], ir.DoubleType().as_pointer()))
        return context.get_dummy_value()

    return types.void(types.intp, types.float64), codegen


@intrinsic
def call_loop(typingctx, address, n, wires, dt_s):  # type: ignore[no-untyped-def]
    """Call the compiled loop at `address` for `n` locations, whose addresses begin at the address `wires`."""
    from llvmlite import ir
    from numba import types

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        whole = args[1].type
        function = ir.FunctionType(ir.VoidType(), [whole, whole.as_pointer(), ir.DoubleType()])
        callee = builder.inttoptr(args[0], function.as_pointer())
        builder.call(callee, [args[1], builder.inttoptr(args[2], whole.as_pointer()), args[3]])
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, types.intp, types.float64), codegen


class Step:
    """The compiled step of an effect; the Python function stays as `__wrapped__`.

    `key` names the step and what it was made from. Two steps are equal when they are the same object.
    """

    __name__: str
    __qualname__: str

    def __init__(self, function: Callable[..., float]) -> None:
        update_wrapper(cast(Any, self), function)
        self._function: Any = function
        self.key = f"{function.__module__}.{function.__qualname__}.{_checksum(self._function.__code__)}"

    @cached_property
    def _read(self) -> set[str]:
        return {name for i in dis.get_instructions(self._function) for name in _loaded(i)}

    @cached_property
    def alone(self) -> tuple[str, str]:
        """The step for one location, as LLVM's text and the name of its function, compiled or read from disk now.

        It takes signal, position, rate, aux and dt_s as float64, then the addresses of parameters and state.
        """
        made = Callback(self._function, _ALONE, error_model="numpy")
        entry = entry_name(self.__name__.strip("_") + "-text", made.stamp())
        if kept := read_entry(entry):
            text, name = json.loads(kept)
            return text, name
        text, name = made.alone
        keep_entry(entry, json.dumps([text, name]).encode())
        return text, name

    def reads(self, argument: str) -> bool:
        """Tell whether the step looks at one of its arguments, by name."""
        return argument in self._read


def compiled(step: Callable[..., float]) -> Step:
    """Return the Step of `step`(signal, position, rate, aux, dt_s, parameters, state) -> contribution.

    `signal` is the value at the effect's location before it (command, current, torque, sensor, reading), `position` and
    `rate` the motion of its coordinate, `aux` the value of its auxiliary source (see Aux) and `dt_s` the time step.
    `parameters` and `state` are pointers to this location's own numbers.
    """
    return Step(step)


def _checksum(code: CodeType) -> str:
    return f"{crc32(repr((code.co_code, code.co_consts, code.co_names)).encode()):08x}"


def _loaded(instruction: dis.Instruction) -> tuple[str, ...]:
    """Return the local variables that an instruction reads."""
    if not instruction.opname.startswith("LOAD_FAST"):
        return ()
    names = instruction.argval
    return names if isinstance(names, tuple) else (names,)
