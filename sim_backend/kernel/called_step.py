"""The loop over all places of one effect, which a bench's loop calls by its address once per sample."""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from sim_backend.effects.compiled import WIRES
from sim_backend.kernel.code import F64, I64, index, repeated
from sim_backend.kernel.structure import step_symbol

ARGUMENTS: list[Any] = [*[F64] * 5, *[F64.as_pointer()] * 2]
"""Of a step: signal, position, rate, aux and dt_s, then the addresses of parameters and state."""


def emit_places(key: str, name: str) -> ir.Module:
    """Return the module whose function `name`(number of places, their addresses, dt_s) adds what each place gives.

    `key` names the step; a place has WIRES addresses: of signal, position, rate, aux, target, parameters and state.
    """
    module = ir.Module("places")
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), [I64, I64.as_pointer(), F64]), name)
    step = ir.Function(module, ir.FunctionType(F64, ARGUMENTS), step_symbol(key))
    at = ir.IRBuilder(function.append_basic_block("entry"))
    count, wires, dt_s = function.args
    with repeated(at, count, "place") as i:
        own = at.gep(wires, [at.mul(i, index(WIRES))])
        *signals, target, parameters, state = (
            at.inttoptr(at.load(at.gep(own, [index(k)])), F64.as_pointer()) for k in range(WIRES)
        )
        # the compiler leaves out the signals that the step does not use
        added = at.call(step, [*(at.load(signal) for signal in signals), dt_s, parameters, state])
        at.store(at.fadd(at.load(target), added), target)
    at.ret_void()
    return module
