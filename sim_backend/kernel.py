"""The one compiled time loop: plant, effects, sensors and controllers, one pass per sample.

Order within one sample k, which starts at time t_k:
 1. read: positions from the states, then sensor heads and readings with their effects;
 2. control: feedback, learning and feed-forward give the command held until t_{k+1};
 3. drive: command effects, delay, amplifiers (currents) with theirs, torques on the inputs;
 4. step: `substeps` exact zero-order-hold steps of every mode. Drive effects see the position extrapolated to
 mid-step, and
    torques that depend on motion are themselves extrapolated there (3/2 f_k - 1/2 f_{k-1}): the loop is second-order
    accurate for smooth effects at no cost.

Effects are called through the addresses of their compiled steps, so that this loop is compiled once for whatever
effects a model holds, and an effect's file stays the only place that knows its physics. All compiled helpers stand in
this one file because numba's cache does not notice edits in others.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import njit, types

from sim_backend.effects.base import Site
from sim_backend.effects.compiled import call_loop, intrinsic, load, store
from sim_backend.stages import call

_COMMAND, _CURRENT, _DRIVE, _STRUCTURE = (
    int(Site.COMMAND),
    int(Site.CURRENT),
    int(Site.DRIVE),
    int(Site.STRUCTURE),
)
_HEAD, _READING = int(Site.HEAD), int(Site.READING)
NO_DELAY = 0
"""Columns of a queue in which nothing waits."""

# Nothing here allocates, so reference counting is switched off: counting the references of some sixty arrays at every
# call took nine tenths of the time. Inlining is forced for the same reason, the arguments are tuples of many arrays.
_OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "_nrt": False}
_compiled = njit(**_OPTIONS)
_inlined = njit(**_OPTIONS, forceinline=True)


@intrinsic
def _dot(typingctx, matrix, row, vector, length):  # type: ignore[no-untyped-def]
    """Return the product of a row of `matrix` with `vector`, both as long as the tuple `length`, without a loop."""
    n = len(length)

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        first, second = (context.make_array(signature.args[i])(context, builder, args[i]).data for i in (0, 2))
        start, total = builder.mul(args[1], ir.Constant(args[1].type, n)), ir.Constant(ir.DoubleType(), 0.0)
        for j in range(n):
            at = builder.add(start, ir.Constant(args[1].type, j))
            values = builder.gep(first, [at]), builder.gep(second, [ir.Constant(args[1].type, j)])
            term = builder.fmul(*map(builder.load, values))
            total = term if j == 0 else builder.fadd(total, term)
        return total

    return types.float64(matrix, types.intp, vector, length), codegen


@intrinsic
def _put(typingctx, source, table, row, length):  # type: ignore[no-untyped-def]
    """Copy `source`, as long as the tuple `length`, into a row of `table`, without a loop."""
    n = len(length)

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        first, second = (context.make_array(signature.args[i])(context, builder, args[i]).data for i in (0, 1))
        start = builder.mul(args[2], ir.Constant(args[2].type, n))
        for j in range(n):
            value = builder.load(builder.gep(first, [ir.Constant(args[2].type, j)]))
            builder.store(value, builder.gep(second, [builder.add(start, ir.Constant(args[2].type, j))]))
        return context.get_dummy_value()

    return types.void(source, table, types.intp, length), codegen


@_inlined
def _apply(fx, site, dt_s):  # type: ignore[no-untyped-def]
    """Let every effect of a site add its contributions, one call for all places of an effect."""
    for b in range(fx.site[site], fx.site[site + 1]):
        first = fx.batch[b]
        wires = types.intp(fx.wires.ctypes.data) + 8 * fx.wires.shape[1] * first
        call_loop(fx.address[first], fx.batch[b + 1] - first, wires, dt_s)


@_inlined
def _at(array):  # type: ignore[no-untyped-def]
    """Return the address of an array's numbers."""
    return types.intp(array.ctypes.data)


@_inlined
def _motion(plant, fx, mem, bus):  # type: ignore[no-untyped-def]
    """Fill positions and rates from modal states and the torque in force, and the coordinates that effects watch."""
    n_u, n_y, position, rate = len(bus.inputs), len(bus.outputs), _at(bus.position), _at(bus.rate)
    links = (_at(plant.seen), _at(plant.seen_mode), _at(plant.c), _at(mem.x), _at(plant.rate_d), _at(mem.torque))
    call(bus.stages[0], (n_y, n_u, *links, position, rate))
    if plant.feedthrough == 1:
        for i in range(n_y):
            bus.position[i] += _dot(plant.d, i, mem.torque, bus.inputs)
    for c in range(bus.at.size):
        bus.at[c] = _dot(fx.coordinates, c, bus.position, bus.outputs)
    for c in range(bus.speed.size):
        bus.speed[c] = _dot(fx.coordinates, c, bus.rate, bus.outputs)


@_inlined
def _advance(plant, mem, bus):  # type: ignore[no-untyped-def]
    """Step every mode once under the held torque."""
    links = (_at(plant.a), _at(plant.driven), _at(plant.driven_by), _at(plant.b))
    call(bus.stages[1], (mem.x.shape[0], *links, _at(bus.torque), _at(mem.x)))


@_inlined
def _multiply(matrix, vector, out, columns, rows):  # type: ignore[no-untyped-def]
    """Fill `out` with the product of `matrix` and `vector`."""
    for i in range(len(rows)):
        out[i] = _dot(matrix, i, vector, columns)


@_inlined
def _keep(table, at, values, length):  # type: ignore[no-untyped-def]
    """Copy `values` into a column of `table`, unless it has none."""
    if table.shape[1]:
        for j in range(len(length)):
            table[j, at] = values[j]


@_inlined
def _control(ctl, wave, mem, k, bus):  # type: ignore[no-untyped-def]
    """Fill the command from feed-forward, feedback and learning at sample `k` of the period."""
    n, row = len(bus.inputs), 8 * len(bus.inputs) * k
    blocks = (_at(ctl.fa), _at(ctl.fb), _at(ctl.fc), _at(ctl.fd), _at(mem.xf), _at(mem.closed))
    waves = (_at(wave.reference) + row, _at(wave.feedforward) + row)
    call(bus.stages[2], (n, mem.xf.shape[1], *blocks, *waves, _at(bus.reading), _at(bus.command)))
    for i in range(n):
        if ctl.learning[i] >= 0:
            bus.error[0] = wave.reference[k, i] - bus.reading[i]
            _learn(ctl, mem, i, bus)


@_inlined
def _learn(ctl, mem, i, bus):  # type: ignore[no-untyped-def]
    """Add the repetitive input of axis `i` to its command."""
    length, n_taps, m = mem.ring.shape[1], ctl.taps.shape[1], mem.xl.shape[1]
    loop = (mem.samples[0], ctl.period[i], ctl.lead[i], ctl.learning[i], length, n_taps, m)
    own = (_at(ctl.taps) + 8 * n_taps * i, _at(ctl.gain) + 8 * i, _at(bus.error))
    blocks = (_at(ctl.la) + 32 * m * i, _at(ctl.lb) + 16 * m * i, _at(ctl.lc) + 16 * m * i, _at(ctl.ld) + 8 * i)
    past = (_at(mem.xl) + 16 * m * i, _at(mem.ring) + 8 * length * i, _at(mem.learned) + 8 * length * i)
    call(bus.stages[3], (*loop, *own, *blocks, *past, _at(bus.command) + 8 * i))


@_inlined
def _gate(ctl, wave, mem, k, event):  # type: ignore[no-untyped-def]
    """Open and close the feedback at the events of sample `k`; return the row of the next event."""
    while event < wave.events.shape[0] and int(wave.events[event, 0]) == k:
        axis = int(wave.events[event, 1])
        closing = int(wave.events[event, 2])
        if closing == 1 and mem.closed[axis] == 0:
            for m in range(mem.xf.shape[1]):
                mem.xf[axis, m, 0], mem.xf[axis, m, 1] = 0.0, 0.0
            block = ctl.integrator[axis]
            if block >= 0:
                mem.xf[axis, block, 0] = wave.events[event, 3] / ctl.fc[axis, block, 0]
        mem.closed[axis] = closing
        event += 1
    return event


@_inlined
def _delay(plant, mem, bus):  # type: ignore[no-untyped-def]
    """Fill `delayed` with the commands of each input's past that stand for the delayed one, weighted."""
    depth = mem.queue.shape[1]
    if depth == NO_DELAY:
        _put(bus.driven, bus.delayed, 0, bus.inputs)
        return
    head = mem.samples[0] % depth
    for j in range(len(bus.inputs)):
        mem.queue[j, head] = bus.driven[j]
        bus.delayed[j] = 0.0
        at = head - plant.delay_first[j]
        for i in range(plant.delay_taps.shape[1]):
            at += depth if at < 0 else 0
            bus.delayed[j] += plant.delay_taps[j, i] * mem.queue[j, at]
            at -= 1


@_inlined
def _heat(heating, current, temperature, n, dt_s):  # type: ignore[no-untyped-def]
    """Return the temperature one sample on: first order towards cold finger + resistance × dissipated power."""
    power = 0.0
    for i in range(n):
        power += current[i] * current[i] / heating[3]
    return temperature + dt_s / heating[2] * (heating[0] + heating[1] * power - temperature)


@_inlined
def _read(hw, fx, bus, dt_s):  # type: ignore[no-untyped-def]
    """Fill heads and readings from the positions."""
    _multiply(hw.to_heads, bus.position, bus.head, bus.outputs, bus.heads)
    _apply(fx, _HEAD, dt_s)
    _multiply(hw.to_reading, bus.head, bus.reading, bus.heads, bus.outputs)
    _apply(fx, _READING, dt_s)


@_inlined
def _drive(plant, hw, fx, mem, bus):  # type: ignore[no-untyped-def]
    """Fill currents and the torques they hold during this sample."""
    _put(bus.command, bus.driven, 0, bus.inputs)
    _apply(fx, _COMMAND, plant.dt_s)
    _delay(plant, mem, bus)
    _multiply(hw.to_current, bus.delayed, bus.current, bus.inputs, bus.actuators)
    _apply(fx, _CURRENT, plant.dt_s)
    _multiply(hw.to_torque, bus.current, bus.held, bus.actuators, bus.inputs)


@_inlined
def _torque(fx, mem, bus, dt_s):  # type: ignore[no-untyped-def]
    """Fill the torques on the structure for one substep of `dt_s`."""
    n_u = len(bus.inputs)
    _put(bus.held, bus.torque, 0, bus.inputs)
    if fx.site[_DRIVE] < fx.site[_DRIVE + 1]:
        for c in range(bus.middle.size):
            bus.middle[c] = bus.at[c] + 0.5 * dt_s * bus.speed[c]
        _apply(fx, _DRIVE, dt_s)
    for j in range(n_u):
        bus.moving[j] = 0.0
    for m in range(bus.force.size):
        bus.force[m] = 0.0
    _apply(fx, _STRUCTURE, dt_s)
    for m in range(bus.force.size):
        for j in range(n_u):
            bus.moving[j] += fx.levers[m, j] * bus.force[m]
    for j in range(n_u):
        bus.torque[j] += bus.moving[j] + 0.5 * (bus.moving[j] - mem.past[j]) * mem.has_past[0]
        mem.past[j] = bus.moving[j]
    mem.has_past[0] = 1
    _put(bus.torque, mem.torque, 0, bus.inputs)


@_inlined
def _record(out, sample, bus):  # type: ignore[no-untyped-def]
    """Keep what is asked for; an output array without columns is not recorded."""
    at = out.first + sample
    _keep(out.command, at, bus.command, bus.inputs)
    _keep(out.torque, at, bus.torque, bus.inputs)
    _keep(out.current, at, bus.current, bus.actuators)
    _keep(out.position, at, bus.position, bus.outputs)
    _keep(out.reading, at, bus.reading, bus.outputs)
    _keep(out.head, at, bus.head, bus.heads)
    if out.temperature.shape[0]:
        out.temperature[at] = bus.source[1]


@_compiled
def run(n: int, plant: Any, hw: Any, fx: Any, ctl: Any, wave: Any, mem: Any, bus: Any, out: Any) -> None:
    """Play `n` samples; every argument is a tuple of `sim_backend.layout`, `mem` and `out` are filled in place."""
    period, drawn = wave.reference.shape[0], wave.exogenous.shape[0]
    dt_s = plant.dt_s
    bus.source[1] = mem.temperature[0]
    event, k = 0, 0
    for sample in range(n):
        for column in range(drawn):
            bus.exogenous[column] = wave.exogenous[column, sample]
        _motion(plant, fx, mem, bus)
        if plant.feedthrough == 0:
            _read(hw, fx, bus, dt_s)
        event = _gate(ctl, wave, mem, k, event)
        _control(ctl, wave, mem, k, bus)
        _drive(plant, hw, fx, mem, bus)
        if hw.heating[4] > 0.0:
            bus.source[1] = _heat(hw.heating, bus.current, bus.source[1], len(bus.actuators), dt_s)
        for sub in range(plant.substeps):
            if sub > 0:
                _motion(plant, fx, mem, bus)
            _torque(fx, mem, bus, dt_s / plant.substeps)
            if sub == 0:
                if plant.feedthrough == 1:
                    _motion(plant, fx, mem, bus)
                    _read(hw, fx, bus, dt_s)
                _record(out, sample, bus)
            _advance(plant, mem, bus)
        mem.samples[0] += 1
        k += 1
        if k == period:
            event, k = 0, 0
    mem.temperature[0] = bus.source[1]


@_compiled
def contribution_along(fx: Any, e: int, signal: Any, position: Any, rate: Any, aux: Any, dt_s: float, out: Any) -> None:
    """Fill `out` (n,) with what effect `e` adds along given signals, each (n,): its signature before the plant."""
    cell = types.intp(fx.cells.ctypes.data)
    wires = fx.wires[e]
    for i in range(5):
        wires[i] = cell + 8 * i
    wires[5] = types.intp(fx.parameters.ctypes.data) + 8 * fx.p0[e]
    wires[6] = types.intp(fx.states.ctypes.data) + 8 * fx.s0[e]
    for k in range(signal.size):
        store(cell, signal[k])
        store(cell + 8, position[k])
        store(cell + 16, rate[k])
        store(cell + 24, aux[k])
        store(cell + 32, 0.0)
        call_loop(fx.address[e], 1, types.intp(wires.ctypes.data), dt_s)
        out[k] = load(cell + 32)
