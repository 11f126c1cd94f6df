"""The part of the time loop that applies effects at their places: called by address, or inlined one by one."""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from sim_backend.effects.base import Aux, Site
from sim_backend.effects.compiled import WIRES, Step
from sim_backend.kernel.code import F64, I64, Cells, Number, index
from sim_backend.kernel.emission import Emission
from sim_backend.kernel.structure import step_symbol, whole
from sim_backend.kernel.wide_step import wide_step


def emit_effects(loop: Emission, site: Site) -> None:
    """Emit all effects of a site: inlined one by one, or one call for all places of an effect."""
    dt_s = loop.fine_s if site in (Site.DRIVE, Site.STRUCTURE) else loop.dt_s
    if loop.structure.inlined:
        for number, wires in enumerate(loop.wires):
            if wires["site"] == site:
                _inline(loop, site, number, dt_s)
        return
    at, kind = loop.at, ir.FunctionType(ir.VoidType(), [I64, I64.as_pointer(), F64])
    for b in range(*whole(loop.structure.sites)[site : site + 2].tolist()):
        for table in loop.tables:  # lanes have effects of their own, which find the signals of their lane alone
            batch, address = (at.inttoptr(table[name], I64.as_pointer()) for name in ("batch", "address"))
            first, end = (at.load(at.gep(batch, [index(i)])) for i in (b, b + 1))
            wires = at.add(table["wires"], at.mul(first, index(8 * WIRES)))
            function = at.inttoptr(at.load(at.gep(address, [first])), kind.as_pointer())
            at.call(function, [at.sub(end, first), at.inttoptr(wires, I64.as_pointer()), dt_s.lane(0)])


def _inline(loop: Emission, site: Site, number: int, dt_s: Number) -> None:
    """Emit one effect: its step, which the compiler inlines, and the addition of what it gives."""
    wires = loop.wires[number]
    signals = {Site.COMMAND: "driven", Site.CURRENT: "current", Site.HEAD: "head", Site.READING: "reading"}
    signal = loop.bus[signals.get(site, "torque")].part(wires["channel"])
    target = loop.bus["force"].part(wires["moved"]) if site is Site.STRUCTURE else signal
    place = "middle" if site is Site.DRIVE else "at"
    position, size = loop.bus[place], loop.bus_sizes[place]
    column, watched = wires["column"], wires["watched"]
    source = {
        Aux.NONE: 0,
        Aux.TEMPERATURE: 1,
        Aux.SOURCE_COMMAND: 2 + column,
        Aux.SOURCE_POSITION: 2 + loop.n_u + column,
        Aux.EXOGENOUS: 2 + loop.n_u + loop.n_y + column,
    }[Aux(wires["aux"])]
    numbers = [
        signal[0],
        position[watched] if watched < size else loop.zero,
        loop.bus["speed"][watched] if watched < loop.structure.n_rates else loop.zero,
        loop.bus["source"][source],
        dt_s,
    ]
    target[0] = target[0] + _stepped(loop, number, numbers)


def _stepped(loop: Emission, number: int, numbers: list[Number]) -> Number:
    """Emit the step of an effect, each lane with its own parameters and states; return what it gives."""
    parameters, states = (
        loop.mine[name].part(loop.wires[number][first]) for name, first in (("parameters", "p0"), ("states", "s0"))
    )
    step = loop.structure.steps[number]
    arguments = [*(n.value for n in numbers), parameters.place(0), states.place(0)]
    if loop.structure.lanes == 1:
        return Number(loop.at, loop.at.call(_function(loop, step, arguments), arguments))
    name = f"{step_symbol(step.key)}.wide"
    if name not in loop.wide_steps:
        loop.wide_steps[name] = wide_step(loop.module, name, step, loop.structure.lanes)
    if (together := loop.wide_steps[name]) is not None:
        return Number(loop.at, loop.at.call(together, arguments))
    return _one_by_one(loop, number, numbers, (parameters, states))


def _one_by_one(loop: Emission, number: int, numbers: list[Number], arrays: tuple[Cells, Cells]) -> Number:
    """Emit the step for one lane after the other: it finds its numbers one behind the other."""
    sizes = [_size(loop, number, *which) for which in (("p0", "n_parameters"), ("s0", "n_states"))]
    added: list[Any] = []
    for lane in range(loop.structure.lanes):
        for cells, source, size in zip(loop.numbers_of_step, arrays, sizes, strict=True):
            for i in range(size):
                cells[i] = Number(loop.at, source[i].lane(lane))
        arguments = [*(n.lane(lane) for n in numbers), *(cells.place(0) for cells in loop.numbers_of_step)]
        added.append(loop.at.call(_function(loop, loop.structure.steps[number], arguments), arguments))
        for i in range(sizes[1]):
            arrays[1][i] = arrays[1][i].with_lane(lane, loop.numbers_of_step[1][i].value)
    return Number.of_lanes(loop.at, added)


def _size(loop: Emission, number: int, first: str, in_all: str) -> int:
    """Return how many numbers an effect has, the next one's first or the spare one behind the last."""
    starts = [wires[first] for wires in loop.wires]
    end = starts[number + 1] if number + 1 < len(starts) else getattr(loop.structure, in_all) - 1
    return end - starts[number]


def _function(loop: Emission, step: Step, arguments: list[Any]) -> Any:
    name = step_symbol(step.key)
    known = loop.module.globals.get(name)
    return known or ir.Function(loop.module, ir.FunctionType(F64, [a.type for a in arguments]), name)
