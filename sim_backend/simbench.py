"""The simulated bench: a Model, a seed and the compiled loop behind the Bench protocol."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from sim_backend import kernel, layout
from sim_backend.assembly import bus_of, current_from_command, places_of, plant_of, retuned, stated, transducers_of
from sim_backend.bench import UNNAMED, Coil, Identity, Limits, Record, Segment, Signal
from sim_backend.effects.base import Aux, Effect, Site
from sim_backend.errors import ConfigError
from sim_backend.kernel import side_by_side
from sim_backend.loops import controller_of, events_of, fresh_memory, refit_memory
from sim_backend.model import Model, number
from sim_backend.noise import Normals, standard_normal
from sim_backend.wiring import effects_of, require_place

Array = NDArray[np.float64]

_BLOCK = 10_000
"""Samples simulated at once: what is drawn for them stays in the processor's cache, 0.7 MB on the full bench."""


def streams_of(seed: int, effects: Sequence[Effect]) -> dict[int, np.random.Generator]:
    """Return one random stream per random effect.

    It depends on name and location, so that adding an effect changes no other's draws.
    """
    streams: dict[int, np.random.Generator] = {}
    seen: Counter[str] = Counter()
    for effect in effects:
        if effect.aux is not Aux.EXOGENOUS and effect.site is not Site.RECORD:
            continue
        label = f"{effect.name}@{effect.where}"
        streams[id(effect)] = _stream(seed, label, seen[label])
        seen[label] += 1
    return streams


def _stream(seed: int, label: str, rank: int = 0) -> np.random.Generator:
    return np.random.default_rng([seed, crc32(label.encode()), rank])


def _idle(effect: Effect) -> bool:
    """Tell whether a neutral effect is left out of the loop: a file may state it, and no sample has to pay for it.

    That is one of shapes alone, and a disturbance that comes from outside.
    """
    outside = effect.family == "surroundings" and effect.site is Site.STRUCTURE
    return effect.is_neutral() and (outside or not effect.sizes())


def _require_finite(label: str, channels: dict[str, Array]) -> None:
    with np.errstate(over="ignore", invalid="ignore"):
        # the quickest test; if it fails, all are checked, because squares may overflow
        doubtful = [name for name, values in channels.items() if not math.isfinite(np.dot(values, values))]
    for name in doubtful:
        finite = np.isfinite(channels[name])
        if not finite.all():
            raise ConfigError(
                f"segment '{label}': {name} of the simulated bench is not a finite number at "
                f"sample {np.argmin(finite)}; "
                "its model, or the loop closed around it, is unstable or holds an absurd number: correct that"
            )


def _repeated(period: Array, n: int) -> Array:
    """Return a period (k, samples) again and again, shape (k, n): one piece of memory, as `_output` asks for it."""
    out = np.empty((period.shape[0], n))
    done = min(period.shape[1], n)
    out[:, :done] = period[:, :done]
    while done < n:  # a multiple of the period is there
        more = min(done, n - done)
        out[:, done : done + more] = out[:, :more]
        done += more
    return out


Controllers = dict[tuple[int, float], layout.Controller]
"""The loops of a segment by number of axes and rate."""


class Begun(NamedTuple):
    """A segment that a bench is about to play: the channels it asks for, memory for them, and the parts of the loop."""

    bench: SimBench
    segment: Segment
    wanted: tuple[str, ...]
    out: layout.Output
    parts: layout.Parts


def play_side_by_side(benches: Sequence[SimBench], segment: Segment) -> list[Record | ConfigError]:
    """Play one segment on several benches; return for each the record that it would play alone, or its ConfigError.

    Benches of one structure, which differ in numbers only, share one loop, which takes less time. Errors are returned,
    not raised: an unknown channel, another number of axes, or a simulation that diverges.
    """
    controllers: Controllers = {}
    played: list[Begun | Record | ConfigError] = []
    for bench in benches:
        try:
            played.append(bench.begin(segment, controllers))
        except ConfigError as error:
            played.append(error)
    _run(segment, [one for one in played if isinstance(one, Begun)])
    for i, one in enumerate(played):
        if isinstance(one, Begun):
            try:
                played[i] = one.bench.end(one)
            except ConfigError as error:
                played[i] = error
    return [one for one in played if not isinstance(one, Begun)]


def _run(segment: Segment, begun: Sequence[Begun]) -> None:
    events, period = events_of(segment), segment.reference.shape[0]
    reference, feedforward = np.ascontiguousarray(segment.reference), np.ascontiguousarray(segment.feedforward)
    whole = max(_BLOCK // period, 1) * period  # blocks end where a period does, so that gates keep their time
    loops = [kernel.Loop(one.parts, lasting=True) for one in begun]
    for start in range(0, segment.n_samples, whole):
        n = min(whole, segment.n_samples - start)
        waves = [layout.Waveform(reference, feedforward, events, one.bench.draw(n)) for one in begun]
        side_by_side.play(loops, n, waves, [one.out._replace(first=start) for one in begun])


class SimBench:
    """A bench that exists only as a Model; two benches with the same model and seed measure the same numbers.

    `substeps` refines the time grid of the plant and of motion-dependent torques. The recorded channels per axis are
    `command_<dof>` (input), `<dof>` (output), `reference_<dof>` (reference); with hardware also `current_<actuator>`,
    `head_<sensor>` and `temperature`. A hardware with a theodolite has `theodolite_<dof>` for every angle: an
    instrument of its own beside the bench, recorded only by segments that ask for it by name. `truth` adds
    `true_<dof>`, for tests. `disturbance` multiplies everything random that drives or disturbs the mechanism, as it was
    when this bench was played; sensors keep their noise. Raises ConfigError for a level that is negative or not finite.
    """

    def __init__(
        self,
        model: Model,
        seed: int,
        *,
        substeps: int = 1,
        name: str = UNNAMED,
        truth: bool = False,
        disturbance: float = 1.0,
    ) -> None:
        if not 0.0 <= disturbance < math.inf:
            raise ConfigError(f"simulated bench: disturbance is {disturbance}; it must be zero or more, and finite")
        self._model = model
        self._seed = seed
        self._truth = truth
        self._disturbance = disturbance
        self._name = name
        self.places = places_of(model)
        effects = stated(model.effects)
        self._rewriting = [e for e in effects if e.site is Site.RECORD]
        for effect in self._rewriting:
            self.places.find(self.places.outputs, effect.where, effect.name)
        self._linear = retuned(model.linear(), effects, self.places)
        self._substeps = substeps
        self._hw = transducers_of(model)
        for effect in filter(_idle, effects):
            require_place(effect, self.places)
        self._fx, self._effects = effects_of([e for e in effects if not _idle(e)], self.places, self._linear)
        self._streams = streams_of(seed, [*self._effects, *self._rewriting])
        drawing = [e for e in self._effects if e.aux is Aux.EXOGENOUS]
        self._normals = Normals([self._streams[id(e)] for e in drawing])
        stds = [e.drawn_std(self.rate_hz) * (disturbance if e.site < Site.HEAD else 1.0) for e in drawing]
        self._drawn_std = [(row, std) for row, std in enumerate(stds) if std != 1.0]
        hw = model.hardware
        seen = (
            [] if hw is None or hw.theodolite_noise_rad is None else [p.dof for p in model.outputs if p.unit == "rad"]
        )
        self._theodolite = tuple(seen)
        self._sighting: dict[str, np.random.Generator] = {}
        (n_u, n_a), (n_y, n_s) = self._hw.to_torque.shape, self._hw.to_reading.shape
        self._bus = bus_of(n_u, n_a, n_y, n_s, self._fx)
        self._axes = n_u
        self._signals = self._all_signals()

    # Both are made for the first segment: who asks for channels and limits alone, to count a plan or to refuse it,
    # does not wait for scipy's matrix exponential.
    @cached_property
    def _plant(self) -> layout.Plant:
        return plant_of(self._linear, self.rate_hz, self._substeps)

    @cached_property
    def _mem(self) -> layout.Memory:
        return fresh_memory(self._plant, self._axes, self._hw.heating[0])

    @property
    def identity(self) -> Identity:
        """Its public name; never the model's parameters."""
        level = "" if self._disturbance == 1.0 else f" disturbance-{self._disturbance:g}"
        return Identity("sim", self._name, f"seed-{self._seed}{level}", "1")

    @property
    def rate_hz(self) -> float:
        """The sample rate of the loop and of every channel."""
        return self._model.sample_rate_hz

    @property
    def axes(self) -> tuple[str, ...]:
        """The degrees of freedom of the inputs."""
        return self.places.inputs

    @property
    def signals(self) -> tuple[Signal, ...]:
        """Every channel in the order in which it is recorded."""
        return self._signals

    def _all_signals(self) -> tuple[Signal, ...]:
        rate = self.rate_hz
        model = self._model
        out = [Signal(f"command_{p.dof}", p.unit, "input", p.dof, rate) for p in model.inputs]
        out += [Signal(p.dof, p.unit, "output", p.dof, rate) for p in model.outputs]
        out += [Signal(f"reference_{p.dof}", p.unit, "reference", p.dof, rate) for p in model.outputs]
        if model.hardware is not None:
            out += [Signal(f"current_{a}", "A", "aux", a, rate) for a in self.places.actuators]
            out += [Signal(f"head_{s}", "m", "aux", s, rate) for s in self.places.heads]
            out += [Signal("temperature", "K", "aux", "", rate)]
        out += [Signal(f"theodolite_{dof}", "rad", "aux", dof, rate) for dof in self._theodolite]
        if self._truth:
            out += [Signal(f"true_{p.dof}", p.unit, "aux", p.dof, rate) for p in model.outputs]
        return tuple(out)

    @property
    def limits(self) -> Limits:
        """End stops and peak current of the hardware; unlimited without."""
        hw = self._model.hardware
        if hw is None:
            n = len(self.places.outputs)
            return Limits(np.full(n, np.inf), np.inf, np.eye(self._axes))
        angle, z = number(hw.end_stop_angle_rad), number(hw.end_stop_z_m)
        values = hw.force_constant_n_a, hw.actuator_steepness_n_sqrt_w, hw.continuous_force_n
        coil = Coil(*(number(value) for value in values))
        return Limits(np.array([angle, angle, z]), number(hw.peak_current_a), current_from_command(hw), coil)

    def play(self, segment: Segment) -> Record:
        """Play one segment from the present state and return the channels it asks for (all when it names none).

        A segment that sets the cold finger begins once the bench has settled there. Raises ConfigError when the segment
        names an unknown channel or has the wrong number of axes, and when the simulation diverges.
        """
        (record,) = play_side_by_side([self], segment)
        if isinstance(record, ConfigError):
            raise record
        return record

    def begin(self, segment: Segment, controllers: Controllers) -> Begun:
        """Prepare to play a segment; benches with as many axes and the same rate share `controllers`, added to here.

        Raises ConfigError for an unknown channel or another number of axes; whether it diverges shows in `end`.
        """
        wanted = self._wanted(segment)
        if segment.reference.shape[1] != self._axes:
            raise ConfigError(
                f"segment '{segment.label}': {segment.reference.shape[1]} axes, the bench has {self._axes}"
            )
        if segment.cold_finger_k is not None:
            self._hw.heating[0] = segment.cold_finger_k
            self._mem.temperature[0] = segment.cold_finger_k
        kind = self._axes, self.rate_hz
        if kind not in controllers:
            controllers[kind] = controller_of(segment, *kind)
        ctl = controllers[kind]
        self._mem = refit_memory(self._mem, ctl)
        for axis in range(self._axes):
            if axis >= len(segment.feedback) or segment.feedback[axis] is None:
                self._mem.closed[axis] = 0
        parts = layout.Parts(self._plant, self._hw, self._fx, ctl, self._mem, self._bus)
        return Begun(self, segment, wanted, self._output(segment.n_samples, wanted), parts)

    def end(self, begun: Begun) -> Record:
        """Return the record of a segment that was played; raises ConfigError where the simulation has diverged."""
        channels = self._channels(begun.segment, begun.out, begun.wanted)
        _require_finite(begun.segment.label, channels)
        return Record(begun.segment, channels)

    def draw(self, n: int) -> Array:
        """Draw the random numbers of the next `n` samples, shape (n_columns, n)."""
        out = self._normals.next(n)
        for row, std in self._drawn_std:
            out[row] *= std
        return out

    def _wanted(self, segment: Segment) -> tuple[str, ...]:
        names = tuple(s.name for s in self.signals)
        unknown = sorted(set(segment.record) - set(names))
        if unknown:
            raise ConfigError(
                f"segment '{segment.label}': the bench has no channel '{unknown[0]}'; channels: {', '.join(names)}"
            )
        if segment.record:
            return tuple(n for n in names if n in segment.record)
        return tuple(n for n in names if not n.startswith("theodolite_"))

    def _output(self, n: int, wanted: tuple[str, ...]) -> layout.Output:
        (n_u, n_a), (n_y, n_s) = self._hw.to_torque.shape, self._hw.to_reading.shape

        def rows(prefix: str, names: tuple[str, ...]) -> int:
            return n if any(f"{prefix}{name}" in wanted for name in names) else 0

        places = self.places
        sizes = {
            "command": (n_u, rows("command_", places.inputs)),
            "torque": (n_u, 0),
            "current": (n_a, rows("current_", places.actuators)),
            "position": (n_y, max(rows("true_", places.outputs), rows("theodolite_", places.outputs))),
            "reading": (n_y, rows("", places.outputs)),
            "head": (n_s, rows("head_", places.heads)),
            "temperature": (1, rows("", ("temperature",))),
        }
        # one piece of memory: the system hands out large ones much faster than many
        ends = np.cumsum([math.prod(size) for size in sizes.values()])
        parts = np.split(np.empty(ends[-1]), ends[:-1])
        tables = {name: part.reshape(size) for (name, size), part in zip(sizes.items(), parts, strict=True)}
        return layout.Output(**{**tables, "temperature": tables["temperature"][0]}, first=0)

    def _channels(self, segment: Segment, out: layout.Output, wanted: tuple[str, ...]) -> dict[str, Array]:
        places = self.places
        sources: dict[str, Array] = {}
        for prefix, names, array in (
            ("command_", places.inputs, out.command),
            ("", places.outputs, out.reading),
            ("current_", places.actuators, out.current),
            ("head_", places.heads, out.head),
            ("true_", places.outputs, out.position),
        ):
            if array.shape[1]:
                sources.update({f"{prefix}{name}": array[i] for i, name in enumerate(names)})
        sources["temperature"] = out.temperature
        for dof in self._theodolite:
            if f"theodolite_{dof}" in wanted:
                sources[f"theodolite_{dof}"] = self._sighted(dof, out.position)
        outputs = places.outputs[: segment.reference.shape[1]]
        asked = [i for i, dof in enumerate(outputs) if f"reference_{dof}" in wanted]
        rows = _repeated(segment.reference[:, asked].T, segment.n_samples)
        sources.update({f"reference_{outputs[i]}": row for i, row in zip(asked, rows, strict=True)})
        return {name: self._recorded(name, sources[name]) for name in wanted}

    def _sighted(self, dof: str, position: Array) -> Array:
        hw = self._model.hardware
        assert hw is not None and hw.theodolite_noise_rad is not None
        if dof not in self._sighting:
            self._sighting[dof] = _stream(self._seed, f"theodolite@{dof}")
        noise = standard_normal(position.shape[1], self._sighting[dof])
        noise *= number(hw.theodolite_noise_rad)
        noise += position[self.places.outputs.index(dof)]
        return noise

    def _recorded(self, name: str, values: Array) -> Array:
        for effect in self._rewriting:
            if effect.where == name:
                values = effect.rewrite(values, self.rate_hz, self._streams[id(effect)])
        return np.ascontiguousarray(values)

    def safe(self) -> None:
        """Open all loops, zero the drives and forget what was learned: the mechanism then swings out on its own."""
        for held in (self._mem.closed, self._mem.queue, self._mem.xf, self._mem.xl, self._mem.ring, self._mem.learned):
            held[...] = 0

    def close(self) -> None:
        """Nothing is held."""
