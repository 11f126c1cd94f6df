"""From a Model to the arrays of the compiled loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_backend import layout
from sim_backend.effects.base import Aux, Effect, Site
from sim_backend.errors import ConfigError
from sim_backend.kinematics import dof_from_points, points_from_dof
from sim_backend.linear import ModalModel, discretise
from sim_backend.model import Hardware, Model, number

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Places:
    """The channels that an effect's `where` can name.

    Inputs and outputs go by degree of freedom, actuators and sensor heads by name. `levers` (n_a, n_y) gives each
    actuator's own displacement, `sights` (n_s, n_y) what each head sees.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    actuators: tuple[str, ...]
    heads: tuple[str, ...]
    levers: Array
    sights: Array

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
    if model.hardware is None:
        eye = np.eye(len(outputs))
        return Places(inputs, outputs, (), (), np.zeros((0, len(outputs))), eye)
    hw = model.hardware
    return Places(
        inputs,
        outputs,
        tuple(hw.actuators.names),
        tuple(hw.sensors.names),
        points_from_dof(number(hw.actuators.radius_m)),
        points_from_dof(number(hw.sensors.radius_m)),
    )


def plant_of(linear: ModalModel, rate_hz: float, substeps: int) -> layout.Plant:
    """Return the discrete plant, stepped `substeps` times per sample at `rate_hz`."""
    fine = discretise(linear, rate_hz * substeps)
    through = int(np.any(linear.d != 0.0))
    delay = linear.delay_s * rate_hz
    return layout.Plant(
        fine.a, fine.b, fine.c, fine.rate_c, fine.d, fine.rate_d, delay, 1.0 / rate_hz, substeps, through
    )


def transducers_of(model: Model) -> layout.Transducers:
    """Return actuators and sensors; without hardware every input and output is its own."""
    hw = model.hardware
    if hw is None:
        eye_u, eye_y = np.eye(len(model.inputs)), np.eye(len(model.outputs))
        return layout.Transducers(eye_u, eye_u, eye_y, eye_y, np.array([293.15, 0.0, 1.0, 1.0, 0.0]))
    return layout.Transducers(
        current_from_command(hw),
        points_from_dof(number(hw.actuators.radius_m)).T * number(hw.force_constant_n_a),
        points_from_dof(number(hw.sensors.radius_m)),
        dof_from_points(number(hw.sensors.radius_m)),
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


def effects_of(effects: Sequence[Effect], places: Places) -> tuple[layout.Effects, list[Effect]]:
    """Return the effects that act on signals as arrays, and in the same order as objects (sorted by site).

    Exogenous columns are numbered in that order. Raises ConfigError when a `where` names no channel of the bench.
    """
    wired = sorted(
        ((_wire(e, places), e) for e in effects if e.site <= Site.READING), key=lambda pair: int(pair[0].site)
    )
    wires, ordered = [w for w, _ in wired], [e for _, e in wired]
    sites = np.array([int(w.site) for w in wires], dtype=np.int64)
    sizes = np.array([len(e.parameters()) for e in ordered], dtype=np.int64)
    states = np.array([e.n_state for e in ordered], dtype=np.int64)
    drawn = np.cumsum([e.aux is Aux.EXOGENOUS for e in ordered]) - 1
    column = [int(drawn[i]) if e.aux is Aux.EXOGENOUS else w.column for i, (w, e) in enumerate(wired)]
    n_y, n_u = len(places.outputs), len(places.inputs)
    return layout.Effects(
        first=np.searchsorted(sites, np.arange(int(Site.READING) + 2)).astype(np.int64),
        address=np.array([e.step.address for e in ordered], dtype=np.int64),
        channel=np.array([w.index for w in wires], dtype=np.int64),
        p0=(np.cumsum(sizes) - sizes).astype(np.int64),
        s0=(np.cumsum(states) - states).astype(np.int64),
        aux=np.array([int(e.aux) for e in ordered], dtype=np.int64),
        column=np.array(column, dtype=np.int64),
        read=np.array([w.read for w in wires]).reshape(len(wires), n_y),
        write=np.array([w.write for w in wires]).reshape(len(wires), n_u),
        weight=np.ones(len(wires)),
        # one spare number each, so that the arrays have an address even when empty
        parameters=np.concatenate([*(e.values() for e in ordered), np.zeros(1)]),
        states=np.concatenate([*(e.start() for e in ordered), np.zeros(1)]),
    ), ordered


def _wire(effect: Effect, places: Places) -> _Wire:
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
    i = places.find(places.inputs, target, effect.name)
    # the motion an input works against is that of the same degree of freedom; an input without one sees the output of
    # its rank
    at = places.outputs.index(target) if target in places.outputs else min(i, n_y - 1)
    return _Wire(Site.COMMAND if site is Site.CURRENT else site, i, np.eye(n_y)[at], np.eye(n_u)[i], column)


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


def bus_of(n_u: int, n_a: int, n_y: int, n_s: int) -> layout.Bus:
    """Return the loop's scratch memory, all zero."""
    sizes = [n_u] * 6 + [n_a] + [n_y] * 4 + [n_s]
    return layout.Bus._make(np.zeros(size) for size in sizes)
