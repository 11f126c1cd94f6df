"""Recorded inputs played through a linear model with effects, open loop: what a diagnosis compares with the record.

The same compiled loop as the bench, without noise and without controllers. A recorded temperature takes the place of
the simulated one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sim_backend import kernel, layout
from sim_backend.assembly import Places, bus_of, plant_of, retuned
from sim_backend.effects.base import Aux, Effect, Site
from sim_backend.kernel.structure import Structure
from sim_backend.linear import ModalModel, finer_for_delays
from sim_backend.loops import fresh_memory, no_controller, refit_memory
from sim_backend.wiring import effects_of

Array = NDArray[np.float64]

_NO_EVENTS = np.zeros((0, 4))


@dataclass(frozen=True)
class Motion:
    """What a replay gives: readings and positions (n, n_y), torques on the structure (n, n_u), final states (m, 2).

    Torques are those at the beginning of each sample, everything that acts at an input added up, or their means over
    the sample where a delay ends within it.
    """

    reading: Array
    position: Array
    torque: Array
    states: Array


@dataclass(frozen=True)
class Stepped:
    """A linear model with effects as the loop steps it: the same for every record.

    `linear` has what its effects change in it, the loop runs `finer` times faster than the samples come. `structures`
    are those of loops that were played, by how many columns are recorded for their effects.
    """

    linear: ModalModel
    finer: int
    plant: layout.Plant
    structures: dict[int, Structure | None] = field(default_factory=dict)


def stepped(
    linear: ModalModel, effects: Sequence[Effect], places: Places, rate_hz: float, substeps: int = 1
) -> Stepped:
    """Return `linear` with `effects`, discretised with at least `substeps` steps per sample at `rate_hz`.

    More steps are taken where a delay of parts of a sample needs a faster loop. Raises ConfigError when the model lacks
    the location of an effect.
    """
    linear = retuned(linear, effects, places)
    finer = finer_for_delays(linear, rate_hz)
    return Stepped(linear, finer, plant_of(linear, rate_hz * finer, -(-substeps // finer)))


def replay(
    linear: ModalModel | Stepped,
    effects: Sequence[Effect],
    places: Places,
    transducers: layout.Transducers,
    u: Array,
    rate_hz: float,
    *,
    temperature_k: Array | None = None,
    start: Array | None = None,
    substeps: int = 1,
) -> Motion:
    """Play `u` (n, n_u) from modal states `start` (m, 2; rest when None) and return the motion.

    Where a delay needs a faster loop, it runs a whole number of times faster. Random numbers of effects are zero. A
    `Stepped` has to be made with the same effects, rate and substeps. Raises ConfigError when the model lacks the
    location of an effect.
    """
    ready = linear if isinstance(linear, Stepped) else stepped(linear, effects, places, rate_hz, substeps)
    linear, finer, plant = ready.linear, ready.finer, ready.plant
    if finer > 1:
        held = None if temperature_k is None else np.repeat(temperature_k, finer)
        u, temperature_k = np.repeat(u, finer, axis=0), held
    n, n_u = u.shape
    rate_hz *= finer
    fx, ordered = effects_of(effects, places, linear)
    columns: list[Array] = []
    for i, effect in enumerate(ordered):
        if effect.aux is Aux.TEMPERATURE and temperature_k is not None:
            fx.aux[i], fx.column[i] = int(Aux.EXOGENOUS), len(columns)
            columns.append(temperature_k)
        elif effect.aux is Aux.EXOGENOUS:
            fx.column[i] = len(columns)
            columns.append(np.zeros(n))
    exogenous = np.stack(columns) if columns else np.zeros((0, 0))
    ctl = no_controller(n_u)
    mem = refit_memory(fresh_memory(plant, n_u, transducers.heating[0]), ctl)
    if start is not None:
        mem.x[: start.shape[0]] = start
    out = _what_is_kept(n, n_u, transducers)
    wave = layout.Waveform(np.zeros_like(u), np.ascontiguousarray(u), _NO_EVENTS, exogenous)
    n_y, n_s = transducers.to_reading.shape
    bus = bus_of(n_u, transducers.to_torque.shape[1], n_y, n_s, fx)
    loop = kernel.Loop(layout.Parts(plant, transducers, fx, ctl, mem, bus), ready.structures.get(len(columns)))
    loop.play(n, wave, out)
    ready.structures[len(columns)] = loop.called
    # a mean of single numbers takes as long as one of many
    torque = out.torque if finer == 1 else out.torque.reshape(n_u, -1, finer).mean(axis=2)
    reading, position, torque = (
        np.ascontiguousarray(table.T) for table in (out.reading[:, ::finer], out.position[:, ::finer], torque)
    )
    for effect in effects:
        if effect.site is Site.RECORD:
            at = places.find(places.outputs, effect.where, effect.name)
            reading[:, at] = effect.rewrite(reading[:, at], rate_hz / finer)
    return Motion(reading, position, torque, mem.x)


def _what_is_kept(n: int, n_u: int, transducers: layout.Transducers) -> layout.Output:
    n_y, n_s = transducers.to_reading.shape
    n_a = transducers.to_torque.shape[1]
    return layout.Output(
        command=np.zeros((n_u, 0)),
        torque=np.zeros((n_u, n)),
        current=np.zeros((n_a, 0)),
        position=np.zeros((n_y, n)),
        reading=np.zeros((n_y, n)),
        head=np.zeros((n_s, 0)),
        temperature=np.zeros(0),
        first=0,
    )
