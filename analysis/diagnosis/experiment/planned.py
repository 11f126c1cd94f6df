"""A plan in simulation: what a bench that behaves like a hypothesis would record, and whether it keeps its limits.

Nothing moves: only the public description of a bench is read. An investigation starts with as much motion as that
allows, and periods that repeat.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import msgspec
import numpy as np

from analysis.diagnosis.records.dataset import Record, Window, period_within
from campaigns.plans import Plan, checked_segments
from campaigns.plans.base import Reach, rate_of
from campaigns.plans.multisine import Multisine
from sim_backend.assembly import places_of, retuned, stated
from sim_backend.bench import Bench, Identity, Limits, Segment, Signal
from sim_backend.bench import Record as BenchRecord
from sim_backend.effects import Aux, effect_class
from sim_backend.errors import ConfigError, DataError
from sim_backend.linear import Array, ModalModel
from sim_backend.model import Model
from sim_backend.simbench import SimBench

if TYPE_CHECKING:  # they bring the whole search, for which a first experiment does not wait
    from analysis.diagnosis.experiment.hypotheses import Hypothesis
    from analysis.diagnosis.fitting.fit import Setting


LEVELS = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02)
"""Amplitudes at which plans are offered, as parts of what the bench can play; where a plan excites a resonance
only small ones keep the limits."""

MARGIN = 0.9
"""Part of the bench's travel and current that a proposal may be predicted to use: the prediction may be wrong by some
per cent, and by more where the hypotheses are all wrong."""


@dataclass(frozen=True)
class Headroom:
    """What a proposal may use: travel per output (n_y,) and current per actuator, as predicted; infinite: anything."""

    travel: Array
    current_a: float


@dataclass(frozen=True)
class Played:
    """What a plan would give under a hypothesis: the record as a log would hold it, and the true positions (n, n_y)."""

    record: Record
    position: Array


def bench_or_modelled(bench: Bench | None, model: Model, rate_hz: float) -> Bench:
    """Return `bench`, or where none is given the one that `model` describes, sampled at `rate_hz`."""
    return bench or SimBench(msgspec.structs.replace(model, sample_rate_hz=rate_hz), 0)


def headroom_of(bench: Bench, setting: Setting) -> Headroom:
    """Return what a proposal may use: the bench's limits; where it states none, what was recorded already."""
    travel = np.full(setting.data.n_outputs, np.inf)
    for o, dof in enumerate(setting.places.outputs):
        if dof in bench.axes:
            travel[o] = bench.limits.reference[bench.axes.index(dof)]
    seen = np.max([np.max(np.abs(r.y), axis=0) for r in setting.data.records], axis=0)
    # the margin is for the limits of a bench; what was recorded did no harm
    return Headroom(np.where(np.isfinite(travel), travel, seen / MARGIN), float(bench.limits.current_a))


def records_motion(plan: Plan, bench: Bench, model: Model) -> bool:
    """Tell whether a log of `plan` can be diagnosed: it holds every input and every output of `model`."""
    dofs = {(s.role, s.dof) for s in bench.signals if s.name in plan.channels(bench)}
    needed = {("input", p.dof) for p in model.inputs} | {("output", p.dof) for p in model.outputs}
    return needed <= dofs


def play_as(
    plan: Plan, bench: Bench, model: Model, hypothesis: Hypothesis, setting: Setting, headroom: Headroom
) -> Played | None:
    """Return what `plan` gives under `hypothesis`, None when that leaves the limits or cannot be simulated.

    Only the public description of `bench` is read: nothing moves.
    """
    warm = setting.data.records[0].temperature_k is not None
    paper = hypothesis.model(model, setting)
    return play_on_paper(plan, bench, paper, headroom, substeps=setting.substeps, warm=warm)


def play_on_paper(
    plan: Plan, bench: Bench, model: Model, headroom: Headroom, *, substeps: int = 1, warm: bool = False
) -> Played | None:
    """Return what `plan` for `bench` gives on a bench that is `model`, None when that leaves the limits.

    The temperature is kept where there is one and `warm`.
    """
    try:
        segments = list(checked_segments(plan, bench))
        paper = SimBench(model, 0, substeps=substeps, truth=True)
        played = [paper.play(_on_paper(s, bench.axes, paper)) for s in segments]
    except (ConfigError, DataError):
        return None
    ins, outs = [p.dof for p in model.inputs], [p.dof for p in model.outputs]

    def joined(names: list[str]) -> Array:
        return np.concatenate([np.stack([r.channels[n] for n in names], axis=1) for r in played])

    u, y = joined([f"command_{dof}" for dof in ins]), joined(outs)
    position = joined([f"true_{dof}" for dof in outs])
    if not (np.isfinite(y).all() and np.isfinite(u).all()):
        return None
    current = np.max(np.abs(u @ paper.limits.to_current.T), initial=0.0)
    if np.any(np.max(np.abs(position), axis=0) > MARGIN * headroom.travel) or current > MARGIN * headroom.current_a:
        return None
    windows, at = [], 0
    for segment in segments:
        repeats = period_within(segment.settings.get("period_samples"), segment.n_samples)
        windows.append(Window(segment.label, at, at + segment.n_samples, "held-out" in segment.label, repeats))
        at += segment.n_samples
    warm = warm and "temperature" in played[0].channels
    kelvin = np.concatenate([r.channels["temperature"] for r in played]) if warm else None
    return Played(Record("planned", u, y, tuple(windows), kelvin), position)


def _on_paper(segment: Segment, axes: tuple[str, ...], paper: SimBench) -> Segment:
    """Return a segment for a bench with `axes` as `paper` plays it: with true positions, and on its own axes alone.

    A model may know of fewer axes than the bench has. Raises ConfigError for one that the bench lacks.
    """
    names = tuple(s.name for s in paper.signals if not s.name.startswith(("theodolite_", "current_", "head_")))
    if missing := [axis for axis in paper.axes if axis not in axes]:
        raise ConfigError(f"the bench has no axis {missing[0]}; it has {', '.join(axes)}")
    at = [axes.index(axis) for axis in paper.axes]
    return replace(
        segment,
        record=names,
        reference=np.ascontiguousarray(segment.reference[:, at]),
        feedforward=np.ascontiguousarray(segment.feedforward[:, at]),
        feedback=tuple(segment.feedback[i] for i in at) if segment.feedback else (),
        learning=tuple(segment.learning[i] for i in at) if segment.learning else (),
        gates=tuple(replace(gate, axis=at.index(gate.axis)) for gate in segment.gates if gate.axis in at),
    )


def largest_commands(
    axes: tuple[str, ...], bench: Bench, linear: ModalModel, inputs: tuple[str, ...], headroom: Headroom, largest: Array
) -> Reach:
    """Return the largest commands at which `linear` at rest keeps within `headroom`, axis by axis.

    `largest` (n_u,) are those of a bench that states no limits.
    """
    live = linear.omega_rad_s > 0.0
    static = linear.d + (linear.c[:, live] / linear.omega_rad_s[live] ** 2) @ linear.b[live]
    command = np.zeros(len(bench.axes))
    for axis in axes:
        i, at = inputs.index(axis), bench.axes.index(axis)
        by_travel = np.min(MARGIN * headroom.travel / np.maximum(np.abs(static[:, i]), np.finfo(float).tiny))
        per_unit = float(np.max(np.abs(bench.limits.to_current[:, at]), initial=0.0))
        most = min(by_travel, MARGIN * headroom.current_a / per_unit if per_unit > 0.0 else np.inf)
        stated = np.isfinite(bench.limits.reference).any() and np.isfinite(most)
        command[at] = most if stated else min(most, largest[i])
    return Reach(axes, command)


@dataclass(frozen=True)
class BenchDescription:
    """What a bench is and may be asked: all that plans and proposals need, kept after it was let go."""

    identity: Identity
    signals: tuple[Signal, ...]
    axes: tuple[str, ...]
    limits: Limits

    @classmethod
    def of(cls, bench: Bench) -> Self:
        """Return the description of a bench."""
        return cls(bench.identity, bench.signals, bench.axes, bench.limits)

    def play(self, segment: Segment) -> BenchRecord:
        """Raise ConfigError: there is no bench behind it."""
        raise ConfigError(f"segment '{segment.label}' cannot be played: the bench has been let go; open it again")

    def safe(self) -> None:
        """Nothing moves."""

    def close(self) -> None:
        """Nothing is held."""


def first_plan(bench: Bench, model: Model) -> Plan:
    """Return a multisine on all axes that bench and `model` share: its repeated periods separate noise from motion.

    It has the largest amplitude within the limits by `model`; on a bench that states none, the plan's own. Raises
    ConfigError when bench and model share no axis, and when no multisine keeps the bench's limits by the model.
    """
    places = places_of(model)
    axes = tuple(axis for axis in bench.axes if axis in places.inputs)
    if not axes:
        raise ConfigError(
            f"the bench has the axes {', '.join(bench.axes)}, model '{model.name}' has {', '.join(places.inputs)}; "
            "give a model of this bench"
        )
    limits = dict(zip(bench.axes, bench.limits.reference.tolist(), strict=True))
    headroom = Headroom(np.array([limits.get(dof, np.inf) for dof in places.outputs]), float(bench.limits.current_a))
    usual = Multisine()
    own = np.array([usual.force_rms_n if axis == "z" else usual.torque_rms_nm for axis in places.inputs])
    kept = [e for e in model.effects if effect_class(e.effect).aux is not Aux.EXOGENOUS]
    linear = retuned(model.linear(), stated(kept), places)
    reach = largest_commands(axes, bench, linear, places.inputs, headroom, 3.5 * own)
    quiet = msgspec.structs.replace(model, effects=kept, sample_rate_hz=rate_of(bench))
    for level in LEVELS:
        plan = next(iter(Multisine.offers(bench, reach.scaled(level))))
        if play_on_paper(plan, bench, quiet, headroom) is not None:
            return plan
    raise ConfigError(
        f"by model '{model.name}' no multisine keeps the bench's limits, even at {LEVELS[-1]:g} of its stroke at rest; "
        "choose the first plan with --first and --set"
    )
