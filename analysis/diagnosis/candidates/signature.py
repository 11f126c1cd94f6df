"""Every physical candidate's first-order signature in the outputs, from the one compiled step that also simulates it.

The step runs along the measured motion (the nominal simulation plus what of the residual is above the noise), and
what it adds at its location is passed through the linear plant. So the signature is right to first order even where the
effect is large.

Where the nominal model is good, simulated and measured motion hardly differ; where it is not (a rigid axis under
unmodelled friction, say) the simulation alone would drift away. A Wiener filter removes noise from the residual. A
sensor error is different: the residual is then the error and none of the motion. If it were taken as motion, a sensor's
gain would explain any residual: the nuisances are collinear with everything else that a gain does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
import scipy

from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.nominal.responses import coasting, no_columns, response, simulate, stacked
from analysis.diagnosis.records.dataset import Record
from analysis.diagnosis.side_by_side import side_by_side
from sim_backend import kernel, layout
from sim_backend.assembly import Places
from sim_backend.effects.base import Aux, Effect, Site
from sim_backend.effects.view import RecordView
from sim_backend.errors import ConfigError
from sim_backend.linear import Array, ModalModel, played
from sim_backend.wiring import effects_of

_OVERSUBTRACTION = 6.0
"""A frequency counts as motion only where the smoothed power is this many times the noise: beyond its chance
fluctuations."""

_MOVED = 0.1
"""An output moves when its simulation is at least this part of its residual."""


@dataclass(frozen=True)
class Scales:
    """Natural sizes by which parameters are made dimensionless: per input `u`, per output `y`, seconds and kelvin."""

    u: Array
    y: Array
    s: float
    k: float


@dataclass(frozen=True)
class Candidate:
    """One effect class at one location with fixed shapes; `unit_sizes` are the sizes whose signatures are its columns.

    `centres` are the middles of all starts of the shapes: what is known of them before the data. `choices` is among
    how many shapes the starts were chosen by means of the residual. `limits` are within what the data can show some
    shapes; `given` are fields that are not parameters. `told` are the standard deviations of shapes that the readings
    themselves show, which no fit changes.
    """

    effect: type[Effect]
    where: str
    shapes: dict[str, float]
    unit_sizes: dict[str, float]
    centres: dict[str, float]
    choices: float = 1
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)
    given: dict[str, Any] = field(default_factory=dict)
    told: dict[str, float] = field(default_factory=dict)

    @property
    def key(self) -> tuple[str, str]:
        """What and where, whatever the shapes."""
        return self.effect.name, self.where

    def made(self, sizes: dict[str, float]) -> Effect:
        """Return the effect with these sizes, clipped into its bounds."""
        bounds = {p.name: (p.low, p.high) for p in self.effect.parameters()}
        values = {n: float(np.clip(v, *bounds[n])) for n, v in {**self.shapes, **sizes}.items()}
        return self.effect(self.where, **values, **self.given)


Signal = Literal["u", "position", "sensed", "rate"]


@dataclass(frozen=True)
class Motion:
    """The measured motion of one record: `u` (n, n_u), `position` and `rate` (n, n_y), `residual` (n, n_y).

    `sensed` (n, n_y) is what the sensors saw before any error of theirs.
    """

    u: Array
    position: Array
    sensed: Array
    rate: Array
    residual: Array
    temperature_k: Array | None
    _kept: dict[object, Array] = field(default_factory=dict, init=False, repr=False, compare=False)

    def along(self, what: Signal, read: Array) -> Array:
        """Return one signal weighted by `read` (n_y,), (n,): hundreds of candidates ask for the same few."""
        return self._once((what, read.tobytes()), lambda: getattr(self, what) @ read)

    def at(self, what: Signal, channel: int) -> Array:
        """Return one channel of a signal, (n,)."""
        return self._once((what, channel), lambda: getattr(self, what)[:, channel])

    def _once(self, key: object, made: Callable[[], Array]) -> Array:
        if key not in self._kept:
            self._kept[key] = np.ascontiguousarray(made())
        return self._kept[key]


def places_for(effect: type[Effect], places: Places) -> Iterable[str]:
    """Return every `where` at which this effect is tried."""
    outputs, inputs = places.outputs, places.inputs
    if effect.aux is Aux.SOURCE_COMMAND:
        return [f"{a}->{b}" for a in inputs for b in inputs if a != b]
    if effect.aux is Aux.SOURCE_POSITION:
        targets = outputs if effect.site in (Site.READING, Site.HEAD) else inputs
        return [f"{a}->{b}" for a in outputs for b in targets if a != b]
    return outputs if effect.site in (Site.READING, Site.HEAD, Site.RECORD) else inputs


def enumerate_candidates(
    effects: Iterable[type[Effect]], places: Places, views: dict[str, RecordView], scales: Scales, *, workers: int = 1
) -> list[Candidate]:
    """Return every effect at every location with every start of its shapes; random effects are not among them."""

    def tried(at: tuple[type[Effect], str]) -> list[Candidate]:
        effect, where = at
        view = views[where.rpartition("->")[2]]
        if effect.aux is Aux.TEMPERATURE and view.temperature_k is None:
            return []
        units = unit_sizes(effect, where, places, scales)
        guesses = effect.guess(view)
        centres, choices, limits = _centres(effect, guesses), max(effect.choices(view), 1), effect.limits(view)
        return [
            Candidate(effect, where, shapes, units, centres, choices, limits, effect.given(view, shapes))
            for shapes in guesses
        ]

    searched = [(e, where) for e in effects if e.aux is not Aux.EXOGENOUS for where in places_for(e, places)]
    return [candidate for found in side_by_side(tried, searched, workers=workers) for candidate in found]


def _centres(effect: type[Effect], guesses: list[dict[str, float]]) -> dict[str, float]:
    """Return the middle of the starts of each shape, geometric where it is searched on a logarithmic scale."""
    centres = {}
    for p in effect.parameters():
        values = np.array([g[p.name] for g in guesses if p.name in g and not p.size])
        if values.size:
            centres[p.name] = float(
                np.exp(np.mean(np.log(values))) if p.log and np.all(values > 0.0) else values.mean()
            )
    return centres


def unit_sizes(effect: type[Effect], where: str, places: Places, scales: Scales) -> dict[str, float]:
    """Return the natural size of each size parameter at a location."""
    target = where.rpartition("->")[2]
    j = places.inputs.index(target) if target in places.inputs else 0
    own = target in places.outputs
    y = scales.y[places.outputs.index(target)] if own else np.linalg.norm(places.coordinates[j] * scales.y)
    return {
        p.name: p.dimension.scale(float(scales.u[j]), float(y), scales.s, scales.k)
        for p in effect.parameters()
        if p.size
    }


def signature(
    candidate: Candidate, linear: ModalModel, places: Places, motion: Motion, rate_hz: float, start: Array, run: int = 0
) -> Array:
    """Return the outputs' first-order change, shape (n, n_y, n_columns), one column per size parameter.

    `start` (m, 2) are the states of the linear model in which the motion of the `run` with that number begins. An
    effect without sizes has one column: its whole contribution.
    """
    if candidate.effect.site is Site.MODEL:
        return _of_model(candidate, linear, places, motion.u, rate_hz, start)
    if candidate.effect.site is Site.RECORD:
        return _of_record(candidate, places, motion, rate_hz)
    names = list(candidate.unit_sizes) or [""]
    out = no_columns(motion.position, len(names))
    for k, name in enumerate(names):
        sizes = {n: (candidate.unit_sizes[n] if n == name else 0.0) for n in candidate.unit_sizes}
        _add_signal(candidate.made(sizes).in_run(run), linear, places, motion, rate_hz, out[:, :, k])
    return out


def _add_signal(effect: Effect, linear: ModalModel, places: Places, motion: Motion, rate_hz: float, out: Array) -> None:
    """Add to the outputs `out` (n, n_y) what one effect changes along a motion."""
    fx, _ = effects_of([effect], places)
    added = _added(effect, fx, motion, rate_hz)
    site, channel = _site_of(fx), int(fx.channel[0])
    if site in (Site.READING, Site.HEAD):
        out[:, channel] += added
        return
    response(played(linear, rate_hz), added, channel, through_delay=site is Site.COMMAND, out=out)


def _site_of(fx: layout.Effects) -> Site:
    """Return where the one effect of `fx` acts on this bench."""
    return Site(int(np.searchsorted(fx.first, 1)) - 1)


def force_along(effect: Effect, places: Places, motion: Motion, rate_hz: float) -> tuple[Array, Array, Array]:
    """Return an effect's force (n,) along a motion, the weights of what it answers to (n_y,) and acts on (n_u,)."""
    fx, _ = effects_of([effect], places)
    read = np.eye(len(places.outputs))[fx.column[0]] if effect.aux is Aux.SOURCE_POSITION else fx.read[0]
    onto = fx.levers[fx.moved[0]] if effect.site is Site.STRUCTURE else np.eye(len(places.inputs))[fx.channel[0]]
    return _added(effect, fx, motion, rate_hz), read, onto


def _added(effect: Effect, fx: layout.Effects, motion: Motion, rate_hz: float) -> Array:
    """Return what an effect, alone in `fx`, adds at its location along a motion, (n,): signature before the plant."""
    reading = _site_of(fx) in (Site.READING, Site.HEAD)
    added = np.empty(motion.position.shape[0])
    kernel.contribution_along(
        fx,
        0,
        motion.at("sensed" if reading else "u", int(fx.channel[0])),
        motion.along("sensed" if reading else "position", fx.read[0]),
        motion.along("rate", fx.read[0]),
        _auxiliary(effect, int(fx.column[0]), motion),
        1.0 / rate_hz,
        added,
    )
    return added


def _of_record(candidate: Candidate, places: Places, motion: Motion, rate_hz: float) -> Array:
    o = places.outputs.index(candidate.where)
    values = np.ascontiguousarray(motion.sensed[:, o])
    out = no_columns(motion.position, max(len(candidate.unit_sizes), 1))
    for k, (name, unit) in enumerate(candidate.unit_sizes.items()):
        # a clock's error adds up over the record: a tenth of a sample at its end is still first order
        step = 0.1 / values.size
        effect = candidate.made({n: (step if n == name else 0.0) for n in candidate.unit_sizes})
        out[:, o, k] = (effect.rewrite(values, rate_hz) - values) * (unit / step)
    if not candidate.unit_sizes:
        out[:, o, 0] = candidate.made({}).rewrite(values, rate_hz) - values
    return out


def _auxiliary(effect: Effect, column: int, motion: Motion) -> Array:
    if effect.aux is Aux.TEMPERATURE and motion.temperature_k is not None:
        return motion.temperature_k
    if effect.aux is Aux.SOURCE_COMMAND:
        return motion.at("u", column)
    if effect.aux is Aux.SOURCE_POSITION:
        return motion.at("sensed" if effect.site in (Site.READING, Site.HEAD) else "position", column)
    return np.zeros(motion.u.shape[0])


def _of_model(
    candidate: Candidate, linear: ModalModel, places: Places, u: Array, rate_hz: float, start: Array
) -> Array:
    i = places.inputs.index(candidate.where)
    o = places.outputs.index(candidate.where) if candidate.where in places.outputs else min(i, len(places.outputs) - 1)

    def moved(name: str, by: float) -> Array:
        effect = candidate.made({n: (by if n == name else 0.0) for n in candidate.unit_sizes})
        model = played(effect.retune(linear, i, o), rate_hz)
        return simulate(model, u) + coasting(model, start[: linear.n_blocks], u.shape[0])

    columns = []
    for name, unit in candidate.unit_sizes.items():
        # differences of second order, and small: the part of a column that is not collinear with the nuisances may be
        # 1e-9 of it
        step = 1e-5 * unit
        try:
            slope = (moved(name, step) - moved(name, -step)) / (2.0 * step)
        except ConfigError:  # there is nothing on the other side, as of a delay
            slope = (4.0 * moved(name, step) - moved(name, 2.0 * step) - 3.0 * moved(name, 0.0)) / (2.0 * step)
        columns.append(unit * slope)
    return stacked(columns)


def measured_motion(record: Record, simulated: Array, residual: Array, whitener: Whitener, rate_hz: float) -> Motion:
    """Return the motion of a record from its `simulated` position and the fit's `residual`, both (n, n_y)."""
    cleaned = np.stack([_clean(residual[:, o], whitener, o) for o in range(record.y.shape[1])], axis=1)
    # where next to nothing was driven, all that moves is noise and what leaks from other axes: no motion to act along
    moved = np.std(simulated, axis=0) > _MOVED * np.std(residual, axis=0)
    position = np.where(moved, simulated + cleaned, simulated)
    return Motion(
        record.u, position, simulated, np.gradient(position, 1.0 / rate_hz, axis=0), residual, record.temperature_k
    )


def moved_as(record: Record, position: Array, rate_hz: float) -> Motion:
    """Return the motion of a record along a `position` (n, n_y) that was simulated."""
    rate = np.gradient(position, 1.0 / rate_hz, axis=0)
    return Motion(record.u, position, position, rate, np.zeros_like(position), record.temperature_k)


def as_simulated(motion: Motion, rate_hz: float) -> Motion:
    """Return a motion without what its residual may hold of it."""
    return replace(motion, position=motion.sensed, rate=np.gradient(motion.sensed, 1.0 / rate_hz, axis=0))


def _clean(x: Array, whitener: Whitener, output: int) -> Array:
    """Return `x` (n,) without its noise: reflected at both ends, weighted in frequency, and cut back."""
    n = x.size
    pad = min(n - 1, 4096)
    # odd reflection keeps value and slope at the ends, so that the filter sees no step there
    longer = np.concatenate([2 * x[0] - x[pad:0:-1], x, 2 * x[-1] - x[-2 : -pad - 2 : -1]])
    spectrum = np.fft.rfft(longer)
    power = np.abs(spectrum) ** 2 / longer.size
    total = scipy.ndimage.uniform_filter1d(power, max(power.size // 200, 5), mode="nearest")
    if whitener.repeats:
        noise = 1.0 / np.abs(np.fft.rfft(whitener.taps[output], longer.size)) ** 2
    else:
        noise = np.full(power.size, float(np.quantile(total, 0.1)))
    # noise that leaked into a candidate's motion would correlate with the residual it is compared with: leave all of
    # it out
    gain = np.clip(1.0 - _OVERSUBTRACTION * noise / np.maximum(total, np.finfo(float).tiny), 0.0, 1.0)
    return np.asarray(np.fft.irfft(gain * spectrum, longer.size)[pad : pad + n], dtype=float)
