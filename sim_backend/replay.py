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
from sim_backend.kernel import side_by_side
from sim_backend.linear import ModalModel, finer_for_delays
from sim_backend.loops import fresh_memory, no_controller, refit_memory
from sim_backend.wiring import Connected, connected, with_numbers

Array = NDArray[np.float64]

_NO_EVENTS = np.zeros((0, 4))

_LOOKED_AT = (1 / 32, 1 / 8, 1 / 2, 1.0)
"""Parts of a record after which is looked how far a motion goes: one that runs away does so early, and takes long."""


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

    `linear` has what its effects change in it, the loop runs `finer` times faster than the samples come, and the
    effects are `wired` to it. `structures` are those of loops that were played, by how many columns are recorded for
    their effects.
    """

    linear: ModalModel
    finer: int
    plant: layout.Plant
    wired: Connected
    structures: dict[int, kernel.Structures] = field(default_factory=dict)


def stepped(
    linear: ModalModel, effects: Sequence[Effect], places: Places, rate_hz: float, substeps: int = 1
) -> Stepped:
    """Return `linear` with `effects`, discretised with at least `substeps` steps per sample at `rate_hz`.

    More steps are taken where a delay of parts of a sample needs a faster loop. Raises ConfigError when the model lacks
    the location of an effect.
    """
    linear = retuned(linear, effects, places)
    finer = finer_for_delays(linear, rate_hz)
    plant = plant_of(linear, rate_hz * finer, -(-substeps // finer))
    return Stepped(linear, finer, plant, connected(effects, places, linear))


@dataclass(frozen=True)
class Case:
    """One of the models that go through the same commands: its effects, and the modal states (m, 2) it begins in."""

    ready: Stepped
    effects: Sequence[Effect]
    start: Array | None = None


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
    cases = [Case(ready, effects, start)]
    return replay_together(cases, places, transducers, u, rate_hz, temperature_k=temperature_k)[0]


def replay_together(
    cases: Sequence[Case],
    places: Places,
    transducers: layout.Transducers,
    u: Array,
    rate_hz: float,
    *,
    temperature_k: Array | None = None,
    farthest: Array | None = None,
) -> list[Motion]:
    """Return the motion of every case, to the last bit as `replay` gives it alone; several take less time together.

    A case whose readings at the samples of `u` go beyond `farthest` (n_y,) before a good part is played is given up:
    its readings are infinite.
    """
    motions: dict[int, Motion] = {}
    for finer in {case.ready.finer for case in cases}:
        held = None if temperature_k is None else np.repeat(temperature_k, finer)
        wave = layout.Waveform(*_sent(u, finer), _NO_EVENTS, np.zeros((0, 0)))
        own = {i: case for i, case in enumerate(cases) if case.ready.finer == finer}
        begun = [_begun(case, transducers, wave, held) for case in own.values()]
        _play(begun, u.shape[0], finer, farthest)
        for (i, case), one in zip(own.items(), begun, strict=True):
            motions[i] = _ended(one, case, places, rate_hz)
    return [motions[i] for i in range(len(cases))]


def _play(begun: Sequence[_Begun], n: int, finer: int, farthest: Array | None) -> None:
    """Play cases of `n` samples of `finer` steps, as far as each stays within `farthest` at the samples.

    Between them a fitted model may swing much farther: no reading tells.
    """
    first, left = 0, list(begun)
    for part in (1.0,) if farthest is None else _LOOKED_AT:
        end = round(part * n) * finer
        waves, outs = [one.part(first, end) for one in left], [one.out._replace(first=first) for one in left]
        side_by_side.play([one.loop for one in left], end - first, waves, outs)
        if farthest is not None:
            within = [bool(np.all(np.abs(one.out.reading[:, first:end:finer]) <= farthest[:, None])) for one in left]
            for one, stays in zip(left, within, strict=True):
                if not stays:
                    one.out.reading[:] = np.inf
            left = [one for one, stays in zip(left, within, strict=True) if stays]
        first = end


def _sent(u: Array, finer: int) -> tuple[Array, Array]:
    """Return the reference, which is nothing, and the commands, (n, n_u), of a loop that runs `finer` times faster."""
    sent = np.ascontiguousarray(u if finer == 1 else np.repeat(u, finer, axis=0))
    return np.zeros_like(sent), sent


@dataclass(frozen=True)
class _Begun:
    """A case that is ready to be played, and where its motion will stand."""

    loop: kernel.Loop
    wave: layout.Waveform
    out: layout.Output

    def part(self, first: int, end: int) -> layout.Waveform:
        """Return the wave from one sample to another."""
        if (first, end) == (0, self.wave.feedforward.shape[0]):
            return self.wave
        reference, sent = self.wave.reference[first:end], self.wave.feedforward[first:end]
        drawn = np.ascontiguousarray(self.wave.exogenous[:, first:end])
        return self.wave._replace(reference=reference, feedforward=sent, exogenous=drawn)


def _begun(case: Case, transducers: layout.Transducers, wave: layout.Waveform, temperature_k: Array | None) -> _Begun:
    """Return a case ready to be played through the commands of `wave`."""
    n, n_u = wave.feedforward.shape
    fx, ordered = with_numbers(case.ready.wired, case.effects)
    columns: list[Array] = []
    for i, effect in enumerate(ordered):
        if effect.aux is Aux.TEMPERATURE and temperature_k is not None:
            fx.aux[i], fx.column[i] = int(Aux.EXOGENOUS), len(columns)
            columns.append(temperature_k)
        elif effect.aux is Aux.EXOGENOUS:
            fx.column[i] = len(columns)
            columns.append(np.zeros(n))
    plant, ctl = case.ready.plant, no_controller(n_u)
    mem = refit_memory(fresh_memory(plant, n_u, transducers.heating[0]), ctl)
    if case.start is not None:
        mem.x[: case.start.shape[0]] = case.start
    n_y, n_s = transducers.to_reading.shape
    bus = bus_of(n_u, transducers.to_torque.shape[1], n_y, n_s, fx)
    known = case.ready.structures.get(len(columns))
    loop = kernel.Loop(layout.Parts(plant, transducers, fx, ctl, mem, bus), known)
    case.ready.structures[len(columns)] = loop.structures
    wave = wave._replace(exogenous=np.stack(columns) if columns else wave.exogenous)
    return _Begun(loop, wave, _what_is_kept(n, n_u, transducers))


def _ended(begun: _Begun, case: Case, places: Places, rate_hz: float) -> Motion:
    """Return the motion of a case that was played."""
    out, finer = begun.out, case.ready.finer
    # a mean of single numbers takes as long as one of many
    torque = out.torque if finer == 1 else out.torque.reshape(out.torque.shape[0], -1, finer).mean(axis=2)
    reading, position, torque = (
        np.ascontiguousarray(table.T) for table in (out.reading[:, ::finer], out.position[:, ::finer], torque)
    )
    for effect in case.effects:
        if effect.site is Site.RECORD:
            at = places.find(places.outputs, effect.where, effect.name)
            reading[:, at] = effect.rewrite(reading[:, at], rate_hz)
    return Motion(reading, position, torque, begun.loop.parts.mem.x)


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
