"""A fitted hypothesis, what stays the same while hypotheses are fitted to one data set, and in how fine steps."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from threading import RLock
from typing import Any, TypeVar, cast

import numpy as np

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.phases import in_phase
from analysis.diagnosis.fitting.starts import Start, beside_states, left_by_best_start, stack_white, without_starts
from analysis.diagnosis.noise.whitener import Bands, Whitener
from analysis.diagnosis.nominal.responses import free_responses, waiting_at
from analysis.diagnosis.nominal.tuning import Nuisance, turned
from analysis.diagnosis.records.dataset import Dataset, Record
from analysis.diagnosis.side_by_side import side_by_side
from sim_backend import layout
from sim_backend.assembly import Places, retuned
from sim_backend.effects.base import UNKNOWN_RUN, Effect, Site
from sim_backend.effects.dominant import residues
from sim_backend.linear import Array, ModalModel, played
from sim_backend.replay import Case, Motion, replay_together, stepped

T = TypeVar("T")

_FINEST = 32
"""The most steps to a sample."""

_ANGLE = 0.06
"""By which a mode may turn within a step."""

_BRAKED = 0.25
"""Part of its rate by which a friction may brake an axis within a step near rest.

From 1 on an explicit step overshoots, from 2 on it swings up: a fit then makes the friction softer than it is.
"""


class Once:
    """What is worked out once of a setting, whichever thread asks for it first."""

    def __init__(self) -> None:
        self._lock, self._found = RLock(), dict[Hashable, Any]()

    def of(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return what `make` gave when `key` was asked for first."""
        with self._lock:
            if key not in self._found:
                self._found[key] = make()
            return cast(T, self._found[key])


@dataclass(frozen=True)
class Setting:
    """What stays the same over all refits of one diagnosis; `states` (m, 2) are the starts known so far, per record.

    `added` is noise that is there beside what the data show of it by themselves, `begin` (n_nuisances,) where the
    nuisances of parts begin to which a hypothesis adds nothing; at the nominal numbers without it.
    """

    data: Dataset
    nominal: ModalModel
    known: tuple[Effect, ...]
    places: Places
    transducers: layout.Transducers
    nuisances: list[Nuisance]
    whitener: Whitener
    starts: tuple[Start, ...]
    states: tuple[Array, ...]
    substeps: int
    workers: int = 2
    added: tuple[Bands, ...] = ()
    begin: Array | None = None
    once: Once = field(default_factory=Once, init=False, repr=False, compare=False)

    def each(self, work: Callable[..., T], *of: Sequence[Any]) -> list[T]:
        """Return `work` done for each record (or whatever `of` lists), side by side where compiled code lets go."""
        return list(side_by_side(work, *of, workers=min(self.workers, len(of[0]))))

    @property
    def rows(self) -> int:
        """Number of fitted numbers: samples times outputs."""
        return sum(int(r.fitted().sum()) for r in self.data.records) * self.data.n_outputs

    @property
    def log_variance(self) -> float:
        """Sum of the logarithms of the noise variances of all fitted numbers."""
        return sum(self.whitener.log_variance(r.fitted()) for r in self.data.records)


@dataclass(frozen=True)
class Fit:
    """A fitted hypothesis: `change` of the nuisances, the `effects`, and the objective with its parts.

    `misfit` is the whitened sum of squares over the fitted samples, `penalty` that of the prior; `values` and their
    standard deviations `std` are in physical units in the order of `names` (number of the effect, parameter);
    `change_std` are those of `change`. `occam` is by how much the data narrowed all parameters, nuisances included: the
    logarithm of the ratio of the prior's volume to the posterior's. `log_variance` is the sum of the logarithms of the
    noise variances that `misfit` is in units of. `residuals` are of simulations that began in `states`, per record.
    `misled` says that slopes with held torques misled the descent: the next one does without them.
    """

    candidates: tuple[Candidate, ...]
    change: Array
    effects: tuple[Effect, ...]
    misfit: float
    penalty: float
    rows: int
    occam: float
    log_variance: float
    names: tuple[tuple[int, str], ...]
    values: Array
    std: Array
    residuals: tuple[Array, ...]
    states: tuple[Array, ...]
    change_std: Array = field(default_factory=lambda: np.zeros(0))
    misled: bool = False

    @property
    def objective(self) -> float:
        """Twice the negative log posterior up to a constant."""
        return self.misfit + self.penalty

    def held(self, keep: Sequence[int] | None = None) -> tuple[list[Candidate], Array]:
        """Return where another refit of these effects (or those numbered in `keep`) starts: shapes and sizes as fitted.

        Sizes (k,) are in units of each candidate's columns, joined; an effect without sizes counts as one whole.
        """
        chosen = range(len(self.effects)) if keep is None else keep
        candidates, sizes = [], np.zeros(0)
        for candidate, effect in ((self.candidates[i], self.effects[i]) for i in chosen):
            candidates.append(replace(candidate, shapes={n: getattr(effect, n) for n in candidate.shapes}))
            own = [getattr(effect, n) / unit for n, unit in candidate.unit_sizes.items()] or [1.0]
            sizes = np.append(sizes, own)
        return candidates, sizes


def linear_of(setting: Setting, fit: Fit) -> ModalModel:
    """Return the linear model of a fit: nuisances adjusted, and what its effects change in the model itself."""
    return retuned(turned(setting.nominal, setting.nuisances, fit.change), fit.effects, setting.places)


def case_of(setting: Setting, linear: ModalModel, effects: Sequence[Effect]) -> Case:
    """Return `linear` with the known effects and `effects`; raises ConfigError where there is no such model.

    Between samples only what acts on the structure changes; without such effects one step per sample is exact.
    """
    acting = [*setting.known, *effects]
    substeps = setting.substeps if any(e.site in (Site.DRIVE, Site.STRUCTURE) for e in acting) else 1
    return Case(stepped(linear, acting, setting.places, setting.data.rate_hz, substeps), acting)


def simulated(setting: Setting, linear: ModalModel, effects: Sequence[Effect]) -> list[Motion]:
    """Return every record replayed through `linear` with the known effects and `effects`."""
    return simulated_together(setting, [case_of(setting, linear, effects)])[0]


def simulated_together(
    setting: Setting, cases: Sequence[Case], farthest: Sequence[Array] | None = None
) -> list[list[Motion]]:
    """Return for each case every record replayed from its known state: together they take less time than one by one.

    A case with a start of its own begins every record there. With `farthest`, (n_y,) for each record, readings of
    motions that go beyond are infinite.
    """

    def played(run: int, record: Record, states: Array) -> list[Motion]:
        own = [
            # states of modes that other effects added stay out
            Case(case.ready, [e.in_run(run) for e in case.effects], begin[: case.ready.linear.n_blocks])
            for case in cases
            for begin in (states if case.start is None else case.start,)
        ]
        given = setting.places, setting.transducers, record.u, setting.data.rate_hz
        limit = None if farthest is None else farthest[run]
        return replay_together(own, *given, temperature_k=record.temperature_k, farthest=limit)

    motions = setting.each(played, range(len(setting.data.records)), setting.data.records, setting.states)
    return [list(own) for own in zip(*motions, strict=True)]


def residuals_of(records: Sequence[Record], moved: Sequence[Motion]) -> tuple[Array, ...]:
    """Return what simulated motions leave of the readings of their records, (n, n_y) each."""
    return tuple(record.left_by(m.reading) for record, m in zip(records, moved, strict=True))


def left_by(setting: Setting, linear: ModalModel, effects: Sequence[Effect]) -> tuple[Array, ...]:
    """Return what a simulation of `linear` with `effects` leaves of the readings of every record, (n, n_y) each."""
    return residuals_of(setting.data.records, simulated(setting, linear, effects))


def begun(setting: Setting, states: Sequence[Array], residuals: Sequence[Array]) -> tuple[Array, ...]:
    """Return `states` (m, 2) per record and on top of them what explains `residuals` (n, n_y) of starts there best."""
    own = zip(setting.data.records, residuals, setting.starts, strict=True)
    found = [start.states(stack_white(setting.whitener, r, e[:, :, None])[:, 0]) for r, e, start in own]
    return tuple(sum_of_states(old, new) for old, new in zip(states, found, strict=True))


def residuals_on(data: Dataset, setting: Setting, fit: Fit) -> tuple[Array, ...]:
    """Return a fit's residuals (n, n_y) on all records of `data`.

    Of one that no fit has seen the state in which it begins is sought, and where it repeats, also as if it had been
    played before: what depends on the level of the motion is then as it is in the steady state. Where it follows
    another, it may go on with that recording: what drifts, counts or remembers does not begin anew then. Which it was
    tells its first period.
    """
    known = {id(r.y): residual for r, residual in zip(setting.data.records, _begun_anew(setting, fit), strict=True)}
    for record in (r for r in data.records if id(r.y) not in known):
        earlier = [r for r in data.records if record.follows(r) and any(e.site is not Site.MODEL for e in fit.effects)]
        ways = {id(r): r for r in (record, record.led_in(), *map(record.going_on_from, earlier))}.values()
        left = [_left_begun(way, data, setting, fit) for way in ways]
        first = slice(0, record.period or record.n)
        known[id(record.y)] = min((e[-record.n :] for e in left), key=lambda e: float(np.sum(e[first] ** 2)))
    return tuple(known[id(r.y)] for r in data.records)


def _begun_anew(setting: Setting, fit: Fit) -> tuple[Array, ...]:
    """Return what a fit leaves (n, n_y) of each of its records, begun where it says that they begin.

    Every comparison takes out what a start can add; the simulation itself began where the fit before this one said.
    """
    setting = replace(setting, states=begun(setting, fit.states, fit.residuals))
    left = left_by(setting, turned(setting.nominal, setting.nuisances, fit.change), fit.effects)
    left = without_starts(setting.data, linear_of(setting, fit), setting.whitener, left)

    def squares(record: Record, residual: Array) -> float:
        return float(np.sum(stack_white(setting.whitener, record, residual[:, :, None]) ** 2))

    pairs = zip(setting.data.records, left, fit.residuals, strict=True)
    return tuple(a if squares(record, a) < squares(record, b) else b for record, a, b in pairs)


def sum_of_states(a: Array, b: Array) -> Array:
    """Return the sum of two sets of states (m, 2); an effect may have added modes to one of them."""
    out = np.zeros((max(a.shape[0], b.shape[0]), 2))
    out[: a.shape[0]] += a
    out[: b.shape[0]] += b
    return out


def _left_begun(record: Record, data: Dataset, setting: Setting, fit: Fit) -> Array:
    """Return what a fit leaves (n, n_y) of a record that no fit has seen, begun in the state that leaves least.

    The search starts from rest, or where the model would begin without what acts on it. Commands that are on their way
    when the record begins are played before it: what acts has to see the motion that they make. An output counts by
    what the fit leaves of it elsewhere: in units of their motions, a noisy one would decide how a quiet one begins.
    """
    linear = turned(setting.nominal, setting.nuisances, fit.change)
    effects = [e.in_run(UNKNOWN_RUN) for e in fit.effects]
    model = played(linear_of(setting, fit), data.rate_hz)
    waiting = waiting_at(model)
    earlier = max(waiting, default=0)
    free, beside = free_responses(model, earlier + record.n)[earlier:], beside_states(model, record)
    states, zeros = free.shape[2], record.zeros()
    on_their_way = [(earlier - count + k, j) for j, count in enumerate(waiting) for k in range(count)]

    def left(acting: Sequence[Effect], starts: Sequence[Array], rows: int) -> list[Array]:
        case, zeros_from = case_of(setting, linear, acting), states + len(on_their_way)
        alike: dict[bytes, list[int]] = {}
        for i, start in enumerate(starts):
            alike.setdefault(start[states:zeros_from].tobytes(), []).append(i)
        found: dict[int, Array] = {}
        for which in alike.values():
            commands = np.zeros((earlier, record.u.shape[1]))
            for place, command in zip(on_their_way, starts[which[0]][states:zeros_from], strict=True):
                commands[place] = command
            some = replace(data, records=(record.first(rows).after(commands),))
            begun = replace(setting, data=some, states=(np.zeros((0, 2)),))
            cases = [replace(case, start=starts[i][:states].reshape(-1, 2)) for i in which]
            for i, moved in zip(which, simulated_together(begun, cases), strict=True):
                residual = residuals_of(some.records, moved)[0]
                found[i] = residual[earlier:] - zeros[:rows] @ starts[i][zeros_from:]
        return [found[i] for i in range(len(starts))]

    weight = (record.fitted() | record.held_out())[:, None] * _weights(setting, fit, record)
    columns = np.concatenate([free, beside], axis=2)
    played_rms = np.sqrt(np.mean(record.u**2, axis=0))
    sent_rms = [played_rms[j] for _, j in on_their_way]
    spread = np.concatenate([np.full(states, np.inf), sent_rms, np.full(zeros.shape[2], np.inf)])
    changed = [e for e in effects if e.site is Site.MODEL]

    def begun_best(acting: Sequence[Effect]) -> Array:
        exact = not setting.known and len(changed) == len(acting)
        return left_by_best_start(partial(left, acting), partial(left, changed), columns, weight, spread, exact=exact)

    rest = np.zeros(columns.shape[2])

    def added(effect: Effect) -> Array:
        (without,), (beside,) = (left(acting, [rest], record.n) for acting in (changed, [*changed, effect]))
        return without - beside

    return begun_best(in_phase(effects, begun_best, added, weight, data.rate_hz))


def _weights(setting: Setting, fit: Fit, record: Record) -> Array:
    """Return how much each output of a record counts, (n_y,): in units of what a fit leaves of it on its own samples.

    The output of which it leaves least for its size counts in units of its own motion, of which steps are small parts.
    """
    fitted = np.concatenate([e[r.fitted()] for r, e in zip(setting.data.records, fit.residuals, strict=True)])
    size = np.std(record.y, axis=0)
    moving = size > 0.0
    left = np.sqrt(np.mean(fitted**2, axis=0))[moving] / size[moving]
    weights = np.zeros(size.size)
    weights[moving] = (left.min(initial=np.inf) / left if np.all(left > 0.0) else 1.0) / size[moving]
    return weights


def positions(setting: Setting, fit: Fit) -> list[Array]:
    """Return the true positions (n, n_y) of every record under a fit."""
    return [m.position for m in simulated(setting, turned(setting.nominal, setting.nuisances, fit.change), fit.effects)]


def steps_of(linear: ModalModel, rate_hz: float) -> int:
    """Return the steps per sample at which a torque that depends on the motion is simulated well enough.

    The loop's error is of second order: at an angle of 0.06 per step of the mode that moves most, 4e-4 of the torque.
    """
    fastest = 0.0
    for i in range(linear.n_inputs):
        for o in range(linear.n_outputs):
            strength = np.abs(residues(linear, i, o)) / np.maximum(linear.omega_rad_s**2, 1e-12)
            if np.any(strength > 0.0):
                fastest = max(fastest, float(linear.omega_rad_s[int(np.argmax(strength))]))
    return int(np.clip(np.ceil(fastest / rate_hz / _ANGLE), 1, _FINEST))


def steps_for(setting: Setting, fits: Sequence[Fit]) -> int:
    """Return the integration steps per sample: the most that an effect of `fits` needs, at least `setting.substeps`."""
    places, most = setting.places, float(setting.substeps)
    for effect in (e for fit in fits for e in fit.effects):
        braking, where = effect.braking(), effect.where
        if braking > 0.0 and where in places.inputs and where in places.outputs:
            j, o = places.inputs.index(where), places.outputs.index(where)
            mobility = abs(float(np.sum(residues(setting.nominal, j, o))))
            most = max(most, braking * mobility / setting.data.rate_hz / _BRAKED)
    return min(int(np.ceil(most)), max(_FINEST, setting.substeps))


def steps_in_noise(setting: Setting, fit: Fit) -> int:
    """Return the steps per sample at which the error of the simulation is lost in the noise, at least those there are.

    The error of n steps is that of one over n², so what twice the steps change is three quarters of it. In units of the
    noise its sum of squares shall be no more than one: then no parameter is wrong by more than a standard deviation.
    """
    linear = turned(setting.nominal, setting.nuisances, fit.change)
    there, finer = (
        left_by(one, linear, fit.effects) for one in (setting, replace(setting, substeps=2 * setting.substeps))
    )
    squares = sum(
        float(np.sum(stack_white(setting.whitener, record, (b - a)[:, :, None]) ** 2))
        for record, a, b in zip(setting.data.records, there, finer, strict=True)
    )
    wanted = setting.substeps * (squares * (4.0 / 3.0) ** 2) ** 0.25
    return int(np.clip(np.ceil(wanted), setting.substeps, max(_FINEST, setting.substeps)))
