"""From a Model to the arrays of the compiled loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim_backend import layout
from sim_backend.effects.base import Aux, Effect, Site
from sim_backend.effects.compiled import WIRES
from sim_backend.errors import ConfigError
from sim_backend.kinematics import dof_from_points, points_from_dof
from sim_backend.linear import ModalModel, delay_taps, discretise
from sim_backend.model import Hardware, Model, number
from sim_backend.modes import is_mode, mode_of, reach_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Places:
    """The channels that an effect's `where` can name.

    Inputs and outputs go by degree of freedom, actuators and sensor heads by name. `levers` (n_a, n_y) gives each
    actuator's own displacement, `sights` (n_s, n_y) what each head sees, `coordinates` (n_u, n_y) the motion that each
    input works against.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    actuators: tuple[str, ...]
    heads: tuple[str, ...]
    levers: Array
    sights: Array
    coordinates: Array

    def find(self, names: tuple[str, ...], where: str, effect: str) -> int:
        """Return the index of `where` in `names`; raises ConfigError naming what there is."""
        if where not in names:
            raise ConfigError(f"effect {effect}: there is no '{where}' on this bench; places: {', '.join(names)}")
        return names.index(where)


@dataclass(frozen=True)
class _Wire:
    """Where one effect is connected: site, channel, coordinate it reads, inputs it writes, and its source channel."""

    site: Site
    index: int
    read: Array
    write: Array
    column: int


def places_of(model: Model) -> Places:
    """Return what effects can be placed on in `model`."""
    inputs, outputs = tuple(p.dof for p in model.inputs), tuple(p.dof for p in model.outputs)
    coordinates = coordinates_of(model)
    if model.hardware is None:
        eye = np.eye(len(outputs))
        return Places(inputs, outputs, (), (), np.zeros((0, len(outputs))), eye, coordinates)
    hw = model.hardware
    return Places(
        inputs,
        outputs,
        tuple(hw.actuators.names),
        tuple(hw.sensors.names),
        points_from_dof(number(hw.actuators.radius_m)),
        points_from_dof(number(hw.sensors.radius_m)),
        coordinates,
    )


def coordinates_of(model: Model) -> Array:
    """Return the motion that each input works against, as weights of the outputs, shape (n_u, n_y), rows of length one.

    It is that of the same degree of freedom, or what the model file states. An input that no sensor stands beside works
    against that combination of the outputs which it moves alone when everything is at rest: a row of the inverse of the
    static gain. Where there is no such inverse (a rigid body, inputs that do the same), it is the output of its rank.
    """
    outputs = [p.dof for p in model.outputs]
    rows = np.eye(len(outputs))[[min(j, len(outputs) - 1) for j in range(len(model.inputs))]]
    for j, port in enumerate(model.inputs):
        if port.dof in outputs:
            rows[j] = np.eye(len(outputs))[outputs.index(port.dof)]
    lone = [j for j, p in enumerate(model.inputs) if p.dof not in outputs and p.dof not in model.coordinates]
    if lone and (inverse := _static_inverse(model.linear())) is not None:
        rows[lone] = inverse[lone] / np.linalg.norm(inverse[lone], axis=1, keepdims=True)
    for j, port in enumerate(model.inputs):
        if stated := model.coordinates.get(port.dof):
            rows[j] = [number(stated.get(p.name, 0.0)) for p in model.outputs]
    return rows


_INVERTIBLE = 1e3
"""Largest condition of a static gain whose inverse still means a direction for every input."""


def _static_inverse(linear: ModalModel) -> Array | None:
    """Return the inverse (n_u, n_y) of the static gain, None where there is none."""
    if linear.n_inputs > linear.n_outputs or np.any(linear.omega_rad_s == 0.0):
        return None
    gain = linear.frequency_response(np.zeros(1))[0].real
    if not np.all(np.isfinite(gain)) or np.linalg.cond(gain) > _INVERTIBLE:
        return None
    return np.asarray(np.linalg.pinv(gain))


def plant_of(linear: ModalModel, rate_hz: float, substeps: int) -> layout.Plant:
    """Return the discrete plant, stepped `substeps` times per sample at `rate_hz`."""
    fine = discretise(linear, rate_hz * substeps)
    mode, by = np.nonzero(np.any(fine.b != 0.0, axis=1))
    gains = np.concatenate([fine.c, fine.rate_c], axis=2)
    output, seen = np.nonzero(np.any(gains != 0.0, axis=2))
    late = [delay_taps(float(seconds * rate_hz)) for seconds in linear.delay_s]
    return layout.Plant(
        a=fine.a,
        driven=np.searchsorted(mode, np.arange(linear.n_blocks + 1)),
        driven_by=np.ascontiguousarray(by),
        b=np.ascontiguousarray(fine.b[mode, :, by]),
        push=_pushed(linear, fine.a),
        seen=np.searchsorted(output, np.arange(linear.n_outputs + 1)),
        seen_mode=np.ascontiguousarray(seen),
        c=np.ascontiguousarray(gains[output, seen]),
        d=fine.d,
        rate_d=fine.rate_d,
        delay_first=np.array([taps.first for taps in late], dtype=np.int64),
        delay_taps=np.stack([taps.weights for taps in late]),
        dt_s=1.0 / rate_hz,
        substeps=substeps,
        feedthrough=int(np.any(linear.d != 0.0)),
    )


def _pushed(linear: ModalModel, step: Array) -> Array:
    """Return what a unit force on each mode alone, held for one `step` (m, 2, 2), adds to its states, shape (m, 2).

    It moves the rest to 1/omega², and the way there is that of a mode let go: (1 - step) of that deflection. A rigid
    body, which has no such rest, is no place for a force.
    """
    omega_2 = linear.omega_rad_s**2
    rest = np.divide(1.0, omega_2, out=np.zeros_like(omega_2), where=omega_2 > 0.0)
    return np.ascontiguousarray((np.array([1.0, 0.0]) - step[:, :, 0]) * rest[:, None])


def transducers_of(model: Model) -> layout.Transducers:
    """Return actuators and sensors; without hardware every input and output is its own."""
    hw = model.hardware
    if hw is None:
        eye_u, eye_y = np.eye(len(model.inputs)), np.eye(len(model.outputs))
        return layout.Transducers(eye_u, eye_u, eye_y, eye_y, np.array([293.15, 0.0, 1.0, 1.0, 0.0]))
    return layout.Transducers(
        np.ascontiguousarray(current_from_command(hw)),
        np.ascontiguousarray(points_from_dof(number(hw.actuators.radius_m)).T) * number(hw.force_constant_n_a),
        points_from_dof(number(hw.sensors.radius_m)),
        np.ascontiguousarray(dof_from_points(number(hw.sensors.radius_m))),
        np.array(
            [
                number(hw.cold_finger_k),
                number(hw.thermal_resistance_k_w),
                number(hw.thermal_time_constant_s),
                # W = (F / steepness)² and F = force constant × A
                (number(hw.actuator_steepness_n_sqrt_w) / number(hw.force_constant_n_a)) ** 2,
                1.0,
            ]
        ),
    )


def current_from_command(hw: Hardware) -> Array:
    """Return the matrix (n_a, n_u) from commands (N m, N m, N) to actuator currents (A). Source: (6.2)."""
    return dof_from_points(number(hw.actuators.radius_m)).T / number(hw.force_constant_n_a)


def effects_of(
    effects: Sequence[Effect], places: Places, linear: ModalModel | None = None
) -> tuple[layout.Effects, list[Effect]]:
    """Return the effects that act on signals as arrays, and in the same order as objects (sorted by site).

    Exogenous columns are numbered in that order. Raises ConfigError when a `where` names no channel of the bench, nor
    a mode of its `linear` model.
    """
    batches = _batches([(_wire(e, places, linear), e) for e in effects if e.site <= Site.READING])
    wires = _of_one_width([w for batch in batches for w, _ in batch])
    ordered = [e for batch in batches for _, e in batch]
    sites = np.array([int(w.site) for w in wires], dtype=np.int64)
    ends = np.cumsum([0, *map(len, batches)])
    sizes = np.array([len(e.parameters()) for e in ordered], dtype=np.int64)
    states = np.array([e.n_state for e in ordered], dtype=np.int64)
    drawn = np.cumsum([e.aux is Aux.EXOGENOUS for e in ordered]) - 1
    column = [
        int(drawn[i]) if e.aux is Aux.EXOGENOUS else w.column
        for i, (w, e) in enumerate(zip(wires, ordered, strict=True))
    ]
    read = np.array([w.read for w in wires]).reshape(len(wires), wires[0].read.size if wires else len(places.outputs))
    coordinates, watched, fast = _coordinates(wires, ordered)
    levers, moved = _rows(
        [w.write for w in wires if w.site is Site.STRUCTURE],
        [w.write for w in wires],
        wires[0].write.size if wires else len(places.inputs),
    )
    return layout.Effects(
        first=np.searchsorted(sites, np.arange(int(Site.READING) + 2)),
        site=np.searchsorted([int(batch[0][0].site) for batch in batches], np.arange(int(Site.READING) + 2)),
        batch=ends,
        steps=tuple(e.step for e in ordered),
        channel=np.array([w.index for w in wires], dtype=np.int64),
        p0=(np.cumsum(sizes) - sizes).astype(np.int64),
        s0=(np.cumsum(states) - states).astype(np.int64),
        aux=np.array([int(e.aux) for e in ordered], dtype=np.int64),
        column=np.array(column, dtype=np.int64),
        read=read,
        coordinates=coordinates,
        watched=watched,
        fast=fast,
        levers=levers,
        moved=moved,
        # one spare number each, so that the arrays have an address even when empty
        parameters=np.concatenate([*(e.values() for e in ordered), np.zeros(1)]),
        states=np.concatenate([*(e.start() for e in ordered), np.zeros(1)]),
        wires=np.zeros((len(wires), WIRES), dtype=np.int64),
        cells=np.zeros(5),
    ), ordered


def _coordinates(wires: Sequence[_Wire], effects: Sequence[Effect]) -> tuple[Array, layout.Ints, int]:
    """Return the coordinates that steps look at, whose they are, and of how many, the first, a rate is wanted too."""
    at_mid_step = [w.read for w in wires if w.site is Site.DRIVE]
    rates = at_mid_step + [w.read for w, e in zip(wires, effects, strict=True) if e.step.reads("rate")]
    positions = [w.read for w, e in zip(wires, effects, strict=True) if e.step.reads("position")]
    n_y = wires[0].read.size if wires else 0
    fast, _ = _rows(rates, [], n_y)
    return *_rows(rates + positions, [w.read for w in wires], n_y), fast.shape[0]


def _rows(needed: Sequence[Array], rows: Sequence[Array], width: int) -> tuple[Array, layout.Ints]:
    """Return the different ones of `needed`, in their order, and the number of each of `rows` among them, else 0."""
    kept = {row.tobytes(): row for row in needed}
    number = {key: i for i, key in enumerate(kept)}
    found = np.array([number.get(row.tobytes(), 0) for row in rows], dtype=np.int64)
    return np.array(list(kept.values()), dtype=float).reshape(len(kept), width), found


def _batches(acting: list[tuple[_Wire, Effect]]) -> list[list[tuple[_Wire, Effect]]]:
    """Return the effects, sorted by site, in groups of the same one at different places.

    The effects of one channel keep their order, for each sees the signal that those before it leave. Torques on the
    structure add up and have no order.
    """
    batches: list[list[tuple[_Wire, Effect]]] = []
    for wire, effect in acting:
        after = -1
        if wire.site is not Site.STRUCTURE:
            here = [i for i, b in enumerate(batches) if any((w.site, w.index) == (wire.site, wire.index) for w, _ in b)]
            after = max(here, default=-1)
        for batch in batches[after + 1 :]:
            if batch[0][0].site is wire.site and type(batch[0][1]) is type(effect):
                batch.append((wire, effect))
                break
        else:
            batches.append([(wire, effect)])
    return sorted(batches, key=lambda batch: int(batch[0][0].site))


def wired(fx: layout.Effects, bus: layout.Bus) -> layout.Effects:
    """Return the effects connected to the signals of a bus; both must be kept as long as they are used."""
    signals = {
        Site.COMMAND: bus.driven,
        Site.CURRENT: bus.current,
        Site.DRIVE: bus.torque,
        Site.STRUCTURE: bus.torque,
        Site.HEAD: bus.head,
        Site.READING: bus.reading,
    }
    first_source = {
        Aux.NONE: 0,
        Aux.TEMPERATURE: 1,
        Aux.SOURCE_COMMAND: 2,
        Aux.SOURCE_POSITION: 2 + bus.driven.size,
        Aux.EXOGENOUS: 2 + bus.driven.size + bus.reading.size,
    }
    wires = np.zeros_like(fx.wires)
    for site, signal in signals.items():
        at = slice(fx.first[site], fx.first[site + 1])
        wires[at, 0] = wires[at, 4] = _addresses(signal, fx.channel[at])
        wires[at, 1] = _addresses(bus.middle if site is Site.DRIVE else bus.at, fx.watched[at])
        if site is Site.STRUCTURE:
            wires[at, 4] = _addresses(bus.force, fx.moved[at])
    source = np.array([first_source[Aux(kind)] for kind in fx.aux], dtype=np.int64)
    has_column = (fx.aux != int(Aux.NONE)) & (fx.aux != int(Aux.TEMPERATURE))
    wires[:, 2] = _addresses(bus.speed, np.where(fx.watched < fx.fast, fx.watched, 0))
    wires[:, 3] = _addresses(bus.source, source + np.where(has_column, fx.column, 0))
    wires[:, 5], wires[:, 6] = _addresses(fx.parameters, fx.p0), _addresses(fx.states, fx.s0)
    return fx._replace(wires=wires)


def _addresses(array: Array, index: layout.Ints) -> layout.Ints:
    return np.asarray(array.ctypes.data + array.itemsize * index, dtype=np.int64)


def _wire_to_mode(effect: Effect, linear: ModalModel) -> _Wire:
    """Return the connection to a mode by itself, after the columns of the outputs and inputs."""
    m = mode_of(linear, effect.where, effect.name)
    reach = reach_of(linear, m)
    read, write = np.zeros(linear.n_outputs + linear.n_blocks), np.zeros(linear.n_inputs + linear.n_blocks)
    read[linear.n_outputs + m], write[linear.n_inputs + m] = reach, linear.omega_rad_s[m] ** 2 / reach
    return _Wire(effect.site, 0, read, write, -1)


def _of_one_width(wires: list[_Wire]) -> list[_Wire]:
    """Return the wires with rows of one length: where one goes to a mode, those of the others go on with zeros."""
    n_read, n_write = (
        max((row.size for row in rows), default=0) for rows in ([w.read for w in wires], [w.write for w in wires])
    )
    return [replace(w, read=_longer(w.read, n_read), write=_longer(w.write, n_write)) for w in wires]


def _longer(row: Array, size: int) -> Array:
    return np.concatenate([row, np.zeros(size - row.size)])


def _wire(effect: Effect, places: Places, linear: ModalModel | None) -> _Wire:
    source, arrow, target = effect.where.partition("->")
    target = target if arrow else source
    n_y, n_u = len(places.outputs), len(places.inputs)
    column = _source(effect, source, places) if effect.aux in (Aux.SOURCE_COMMAND, Aux.SOURCE_POSITION) else -1
    nowhere = np.zeros(n_u)
    site = effect.site
    if target in places.actuators and site in (Site.COMMAND, Site.CURRENT, Site.STRUCTURE):
        i = places.actuators.index(target)
        lever = places.levers[i]
        if site is Site.STRUCTURE:
            return _Wire(site, int(np.argmax(np.abs(lever))), lever, lever, column)
        return _Wire(Site.CURRENT, i, lever, nowhere, column)
    if target in places.heads and site in (Site.HEAD, Site.READING):
        i = places.heads.index(target)
        return _Wire(Site.HEAD, i, places.sights[i], nowhere, column)
    if site in (Site.READING, Site.HEAD):
        i = places.find(places.outputs, target, effect.name)
        return _Wire(Site.READING, i, np.eye(n_y)[i], nowhere, column)
    if linear is not None and site is Site.STRUCTURE and target not in places.inputs and is_mode(target):
        return _wire_to_mode(effect, linear)
    i = places.find(places.inputs, target, effect.name)
    return _Wire(Site.COMMAND if site is Site.CURRENT else site, i, places.coordinates[i], np.eye(n_u)[i], column)


def _source(effect: Effect, source: str, places: Places) -> int:
    if "->" not in effect.where:
        raise ConfigError(
            f"effect {effect.name} goes from one channel to another; write where as 'source->target', not "
            f"'{effect.where}'"
        )
    names = places.inputs if effect.aux is Aux.SOURCE_COMMAND else places.outputs
    return places.find(names, source, effect.name)


def retuned(linear: ModalModel, effects: Sequence[Effect], places: Places) -> ModalModel:
    """Return the linear model with every effect that acts on the model itself applied, in order."""
    for effect in effects:
        if effect.site is Site.MODEL:
            i = places.find(places.inputs, effect.where, effect.name)
            o = (
                places.outputs.index(effect.where)
                if effect.where in places.outputs
                else min(i, len(places.outputs) - 1)
            )
            linear = effect.retune(linear, i, o)
    return linear


def bus_of(n_u: int, n_a: int, n_y: int, n_s: int, fx: layout.Effects) -> layout.Bus:
    """Return the loop's scratch memory, all zero: so many inputs, actuators, outputs and heads, and these effects."""
    n_columns = int(np.max(fx.column[fx.aux == int(Aux.EXOGENOUS)], initial=-1)) + 1
    return layout.Bus(
        source=np.zeros(2 + n_u + n_y + n_columns),
        driven=np.zeros(n_u),
        current=np.zeros(n_a),
        torque=np.zeros(n_u),
        head=np.zeros(n_s),
        reading=np.zeros(n_y),
        at=np.zeros(fx.coordinates.shape[0]),
        speed=np.zeros(fx.fast),
        middle=np.zeros(fx.fast),
        force=np.zeros(fx.levers.shape[0]),
    )
