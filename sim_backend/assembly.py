"""From a Model to the arrays of the compiled loop."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_backend import layout
from sim_backend.effects import make_effect
from sim_backend.effects.base import Aux, Effect, Site
from sim_backend.errors import ConfigError
from sim_backend.kinematics import dof_from_points, points_from_dof
from sim_backend.linear import ModalModel, delay_taps, discretise
from sim_backend.model import EffectEntry, Hardware, Model, number

Array = NDArray[np.float64]


def stated(entries: Iterable[EffectEntry]) -> list[Effect]:
    """Return the effects that entries of a model file state; raises as `make_effect`."""
    return [make_effect(e.effect, e.where, {k: number(v) for k, v in e.parameters.items()}) for e in entries]


@dataclass(frozen=True, eq=False)
class Places:
    """The channels that an effect's `where` can name.

    Inputs and outputs go by degree of freedom, actuators and sensor heads by name. `levers` (n_a, n_y) gives each
    actuator's own displacement, `sights` (n_s, n_y) what each head sees, `coordinates` (n_u, n_y) the motion that each
    input works against. Locations are equal when all of that is.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    actuators: tuple[str, ...]
    heads: tuple[str, ...]
    levers: Array
    sights: Array
    coordinates: Array

    @cached_property
    def _key(self) -> tuple[Any, ...]:
        names = self.inputs, self.outputs, self.actuators, self.heads
        return *names, *(a.tobytes() for a in (self.levers, self.sights, self.coordinates))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Places) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    def find(self, names: tuple[str, ...], where: str, effect: str) -> int:
        """Return the index of `where` in `names`; raises ConfigError naming what there is."""
        if where not in names:
            raise ConfigError(f"effect {effect}: there is no '{where}' on this bench; locations: {', '.join(names)}")
        return names.index(where)


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

    It is that of the same degree of freedom, or what the model file states. An input without a sensor of its own works
    against that combination of the outputs which it alone moves when everything is at rest: a row of the inverse of the
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

    It moves the position of rest to 1/omega², and the motion there is a free response: (1 - step) of that deflection. A
    rigid body has no position of rest, and such a force cannot act on it.
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
