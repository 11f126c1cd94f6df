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
from numba.extending import intrinsic

from sim_backend.effects.base import Aux, Site

_COMMAND, _CURRENT, _DRIVE, _STRUCTURE = (
    int(Site.COMMAND),
    int(Site.CURRENT),
    int(Site.DRIVE),
    int(Site.STRUCTURE),
)
_HEAD, _READING = int(Site.HEAD), int(Site.READING)
_EXOGENOUS, _TEMPERATURE = int(Aux.EXOGENOUS), int(Aux.TEMPERATURE)
_SOURCE_COMMAND, _SOURCE_POSITION = int(Aux.SOURCE_COMMAND), int(Aux.SOURCE_POSITION)

# Nothing here allocates, so reference counting is switched off: counting the references of some sixty arrays at every
# call took nine tenths of the time. Inlining is forced for the same reason, the arguments are tuples of many arrays.
_OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "_nrt": False}
_compiled = njit(**_OPTIONS)
_inlined = njit(**_OPTIONS, forceinline=True)


@intrinsic
def _call_step(  # type: ignore[no-untyped-def]
    typingctx, address, signal, position, rate, aux, dt_s, parameters, state
):
    """Call the compiled step at `address`; `parameters` and `state` are addresses of float64 numbers."""
    real, whole = types.float64, types.intp
    signature = real(whole, real, real, real, real, real, whole, whole)

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        double = ir.DoubleType()
        pointer = double.as_pointer()
        function = ir.FunctionType(double, [double] * 5 + [pointer] * 2)
        callee = builder.inttoptr(args[0], function.as_pointer())
        tail = [builder.inttoptr(a, pointer) for a in args[6:8]]
        return builder.call(callee, [*args[1:6], *tail])

    return signature, codegen


@_inlined
def _contribution(fx, e, signal, position, rate, aux, dt_s):  # type: ignore[no-untyped-def]
    parameters = types.intp(fx.parameters.ctypes.data) + 8 * fx.p0[e]
    state = types.intp(fx.states.ctypes.data) + 8 * fx.s0[e]
    step = fx.address[e]
    return fx.weight[e] * _call_step(step, signal, position, rate, aux, dt_s, parameters, state)  # type: ignore[call-arg]


@_inlined
def _aux(fx, e, k, exogenous, temperature, command, position):  # type: ignore[no-untyped-def]
    kind = fx.aux[e]
    if kind == _EXOGENOUS:
        return exogenous[k, fx.column[e]]
    if kind == _TEMPERATURE:
        return temperature
    if kind == _SOURCE_COMMAND:
        return command[fx.column[e]]
    if kind == _SOURCE_POSITION:
        return position[fx.column[e]]
    return 0.0


@_inlined
def _along(fx, e, values):  # type: ignore[no-untyped-def]
    """Return the coordinate that effect `e` watches."""
    total = 0.0
    for j in range(values.size):
        total += fx.read[e, j] * values[j]
    return total


@_inlined
def _apply(fx, site, values, k, exogenous, temperature, command, position, rate, dt_s):  # type: ignore[no-untyped-def]
    """Add every contribution of a site whose effects act on `values` one channel at a time."""
    for e in range(fx.first[site], fx.first[site + 1]):
        i = fx.channel[e]
        aux = _aux(fx, e, k, exogenous, temperature, command, position)
        values[i] += _contribution(fx, e, values[i], _along(fx, e, position), _along(fx, e, rate), aux, dt_s)


@_inlined
def _motion(plant, x, torque, position, rate):  # type: ignore[no-untyped-def]
    """Fill positions and rates from the modal states and the torque in force."""
    for i in range(position.size):
        at, speed = 0.0, 0.0
        for m in range(x.shape[0]):
            at += plant.c[i, m, 0] * x[m, 0] + plant.c[i, m, 1] * x[m, 1]
            speed += plant.rate_c[i, m, 0] * x[m, 0] + plant.rate_c[i, m, 1] * x[m, 1]
        for j in range(torque.size):
            at += plant.d[i, j] * torque[j]
            speed += plant.rate_d[i, j] * torque[j]
        position[i], rate[i] = at, speed


@_inlined
def _advance(plant, x, torque):  # type: ignore[no-untyped-def]
    """Step every mode once under a held torque."""
    for m in range(x.shape[0]):
        x0, x1 = x[m, 0], x[m, 1]
        n0 = plant.a[m, 0, 0] * x0 + plant.a[m, 0, 1] * x1
        n1 = plant.a[m, 1, 0] * x0 + plant.a[m, 1, 1] * x1
        for j in range(torque.size):
            n0 += plant.b[m, 0, j] * torque[j]
            n1 += plant.b[m, 1, j] * torque[j]
        x[m, 0], x[m, 1] = n0, n1


@_inlined
def _multiply(matrix, vector, out):  # type: ignore[no-untyped-def]
    for i in range(matrix.shape[0]):
        total = 0.0
        for j in range(matrix.shape[1]):
            total += matrix[i, j] * vector[j]
        out[i] = total


@_inlined
def _copy(source, target):  # type: ignore[no-untyped-def]
    """Copy one short vector; a loop, because array assignment costs more than the rest of the sample."""
    for j in range(source.size):
        target[j] = source[j]


@_inlined
def _keep(table, row, values):  # type: ignore[no-untyped-def]
    """Copy `values` into a row of `table`, unless it has no rows."""
    if table.shape[0]:
        for j in range(values.size):
            table[row, j] = values[j]


@_inlined
def _filter(i, a, b, c, d, x, value):  # type: ignore[no-untyped-def]
    """Return the output of axis `i`'s block filter for `value` and advance its states `x` (n, m, 2)."""
    out = d[i] * value
    for m in range(x.shape[1]):
        x0, x1 = x[i, m, 0], x[i, m, 1]
        out += c[i, m, 0] * x0 + c[i, m, 1] * x1
        x[i, m, 0] = a[i, m, 0, 0] * x0 + a[i, m, 0, 1] * x1 + b[i, m, 0] * value
        x[i, m, 1] = a[i, m, 1, 0] * x0 + a[i, m, 1, 1] * x1 + b[i, m, 1] * value
    return out


@_inlined
def _learn(ctl, mem, i, error):  # type: ignore[no-untyped-def]
    """Return axis `i`'s repetitive input u_k = Q (u_{k-N} + k_r L e_{k-N+lead}) and remember it and L e_k.

    While repeating (learning 0) the input of one period ago is played again.
    """
    length = mem.ring.shape[1]
    now = mem.samples[0]
    before = now - ctl.period[i]
    if ctl.learning[i] == 0:
        out = mem.ring[i, before % length]
    else:
        half = ctl.taps.shape[1] // 2
        out = 0.0
        for t in range(-half, half + 1):
            past = mem.ring[i, (before + t) % length]
            correction = mem.learned[i, (before + t + ctl.lead[i]) % length]
            out += ctl.taps[i, t + half] * (past + ctl.gain[i] * correction)
    mem.ring[i, now % length] = out
    mem.learned[i, now % length] = _filter(i, ctl.la, ctl.lb, ctl.lc, ctl.ld, mem.xl, error)
    return out


@_inlined
def _control(ctl, wave, mem, k, reading, command):  # type: ignore[no-untyped-def]
    """Fill `command` from feed-forward, feedback and learning at sample `k` of the period."""
    for i in range(command.size):
        command[i] = wave.feedforward[k, i]
    for i in range(ctl.fd.size):
        error = wave.reference[k, i] - reading[i]
        if mem.closed[i] == 1:
            command[i] += _filter(i, ctl.fa, ctl.fb, ctl.fc, ctl.fd, mem.xf, error)
        if ctl.learning[i] >= 0:
            command[i] += _learn(ctl, mem, i, error)


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
def _delay(plant, mem, command, delayed):  # type: ignore[no-untyped-def]
    """Fill `delayed` with the command `plant.delay` samples ago, on a straight line between samples."""
    depth = mem.queue.shape[1]
    head = mem.samples[0]
    for j in range(command.size):
        mem.queue[j, head % depth] = command[j]
        whole = int(plant.delay[j])
        part = plant.delay[j] - whole
        newer, older = mem.queue[j, (head - whole) % depth], mem.queue[j, (head - whole - 1) % depth]
        delayed[j] = (1.0 - part) * newer + part * older


@_inlined
def _heat(heating, current, temperature, dt_s):  # type: ignore[no-untyped-def]
    """Return the temperature one sample on: first order towards cold finger + resistance × dissipated power."""
    power = 0.0
    for i in range(current.size):
        power += current[i] * current[i] / heating[3]
    return temperature + dt_s / heating[2] * (heating[0] + heating[1] * power - temperature)


@_inlined
def _read(hw, fx, wave, k, temperature, bus, dt_s):  # type: ignore[no-untyped-def]
    """Fill heads and readings from the positions."""
    _multiply(hw.to_heads, bus.position, bus.head)
    _apply(fx, _HEAD, bus.head, k, wave.exogenous, temperature, bus.command, bus.position, bus.rate, dt_s)
    _multiply(hw.to_reading, bus.head, bus.reading)
    _apply(fx, _READING, bus.reading, k, wave.exogenous, temperature, bus.command, bus.position, bus.rate, dt_s)


@_inlined
def _drive(plant, hw, fx, wave, mem, k, temperature, bus):  # type: ignore[no-untyped-def]
    """Fill currents and the torques they hold during this sample."""
    _copy(bus.command, bus.driven)
    dt_s = plant.dt_s
    _apply(fx, _COMMAND, bus.driven, k, wave.exogenous, temperature, bus.command, bus.position, bus.rate, dt_s)
    _delay(plant, mem, bus.driven, bus.delayed)
    _multiply(hw.to_current, bus.delayed, bus.current)
    _apply(fx, _CURRENT, bus.current, k, wave.exogenous, temperature, bus.command, bus.position, bus.rate, dt_s)
    _multiply(hw.to_torque, bus.current, bus.held)


@_inlined
def _torque(fx, wave, mem, k, temperature, bus, dt_s):  # type: ignore[no-untyped-def]
    """Fill the torques on the structure for one substep of `dt_s`."""
    _copy(bus.held, bus.torque)
    for i in range(bus.position.size):
        bus.middle[i] = bus.position[i] + 0.5 * dt_s * bus.rate[i]
    _apply(fx, _DRIVE, bus.torque, k, wave.exogenous, temperature, bus.command, bus.middle, bus.rate, dt_s)
    for j in range(bus.moving.size):
        bus.moving[j] = 0.0
    for e in range(fx.first[_STRUCTURE], fx.first[_STRUCTURE + 1]):
        aux = _aux(fx, e, k, wave.exogenous, temperature, bus.command, bus.position)
        drive = bus.torque[fx.channel[e]]
        f = _contribution(fx, e, drive, _along(fx, e, bus.position), _along(fx, e, bus.rate), aux, dt_s)
        for j in range(bus.moving.size):
            bus.moving[j] += fx.write[e, j] * f
    for j in range(bus.moving.size):
        bus.torque[j] += bus.moving[j] + 0.5 * (bus.moving[j] - mem.past[j]) * mem.has_past[0]
        mem.past[j] = bus.moving[j]
    mem.has_past[0] = 1
    _copy(bus.torque, mem.torque)


@_inlined
def _record(out, sample, temperature, bus):  # type: ignore[no-untyped-def]
    """Keep what is asked for; an output array without rows is not recorded."""
    _keep(out.command, sample, bus.command)
    _keep(out.torque, sample, bus.torque)
    _keep(out.current, sample, bus.current)
    _keep(out.position, sample, bus.position)
    _keep(out.reading, sample, bus.reading)
    _keep(out.head, sample, bus.head)
    if out.temperature.shape[0]:
        out.temperature[sample] = temperature


@_compiled
def run(n: int, plant: Any, hw: Any, fx: Any, ctl: Any, wave: Any, mem: Any, bus: Any, out: Any) -> None:
    """Play `n` samples; every argument is a tuple of `sim_backend.layout`, `mem` and `out` are filled in place."""
    period = wave.reference.shape[0]
    dt_s = plant.dt_s
    temperature = mem.temperature[0]
    event = 0
    for sample in range(n):
        k = sample % period
        if k == 0:
            event = 0
        _motion(plant, mem.x, mem.torque, bus.position, bus.rate)
        if plant.feedthrough == 0:
            _read(hw, fx, wave, sample, temperature, bus, dt_s)
        event = _gate(ctl, wave, mem, k, event)
        _control(ctl, wave, mem, k, bus.reading, bus.command)
        _drive(plant, hw, fx, wave, mem, sample, temperature, bus)
        if hw.heating[4] > 0.0:
            temperature = _heat(hw.heating, bus.current, temperature, dt_s)
        for sub in range(plant.substeps):
            if sub > 0:
                _motion(plant, mem.x, mem.torque, bus.position, bus.rate)
            _torque(fx, wave, mem, sample, temperature, bus, dt_s / plant.substeps)
            if sub == 0:
                if plant.feedthrough == 1:
                    _motion(plant, mem.x, mem.torque, bus.position, bus.rate)
                    _read(hw, fx, wave, sample, temperature, bus, dt_s)
                _record(out, sample, temperature, bus)
            _advance(plant, mem.x, bus.torque)
        mem.samples[0] += 1
    mem.temperature[0] = temperature


@_compiled
def contribution_along(fx: Any, e: int, signal: Any, position: Any, rate: Any, aux: Any, dt_s: float, out: Any) -> None:
    """Fill `out` (n,) with what effect `e` adds along given signals, each (n,): its signature before the plant."""
    for k in range(signal.size):
        out[k] = _contribution(fx, e, signal[k], position[k], rate[k], aux[k], dt_s)
