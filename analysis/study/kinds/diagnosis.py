"""Trials of the diagnosis: an effect is put into the bench, a plan is played, and the model without it is judged."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from analysis.study.kinds.base import Column, Kind, Scalar, Setup
from campaigns.plans import Plan, estimate, make_plan
from campaigns.playing.recording import Recording, play_in_memory
from sim_backend.bench import Bench
from sim_backend.effects import Effect, effect_class, make_effect
from sim_backend.errors import ConfigError
from sim_backend.model import EffectEntry, Model, dump_model, load_model, number
from sim_backend.simbench import SimBench

if TYPE_CHECKING:
    from analysis.diagnosis.records.dataset import Dataset


class _Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`hidden` is the effect that the judged model lacks; with neutral parameters there is nothing to find.

    `nominal` is the model that is judged, by default that of the study before anything was drawn; `tolerance` is how
    far its numbers are trusted. The bench takes `substeps` steps per sample.
    """

    hidden: EffectEntry
    nominal: str | None = None
    plan: str = "multisine"
    plan_settings: dict[str, Any] = {}
    tolerance: float = 0.03
    false_alarm: float = 0.002
    max_effects: int = 3
    substeps: int = 4

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> _Settings:
        try:
            own = msgspec.convert(dict(settings), cls)
        except msgspec.ValidationError as error:
            raise ConfigError(f"[settings] of a diagnosis: {error}; see docs/studies.md for the fields") from None
        if not (0.0 < own.tolerance <= 1.0 and 0.0 < own.false_alarm < 1.0 and own.max_effects > 0):
            raise ConfigError(
                f"[settings] of a diagnosis: tolerance {own.tolerance:g}, false_alarm {own.false_alarm:g}, max_effects "
                f"{own.max_effects}; the first two must lie between 0 and 1, the last above 0"
            )
        if not 1 <= own.substeps <= 64:
            raise ConfigError(f"[settings] of a diagnosis: substeps is {own.substeps}; give 1 to 64")
        return own

    def effect(self) -> Effect:
        return make_effect(
            self.hidden.effect, self.hidden.where, {k: number(v) for k, v in self.hidden.parameters.items()}
        )


class DiagnosisTrial(Kind):
    """A bench with an effect that the judged model lacks: is it seen, is it named, is another one named?

    Where the effect is neutral, "right" is the verdict that nothing is missing, and "seen" is a false alarm.
    """

    name = "diagnosis"
    title = "power of the diagnosis"
    columns = (
        Column("verdict", "consistent, named, ambiguous or unknown", kind="text"),
        Column("seen", "that something is missing is seen", kind="flag"),
        Column("right", "right: all that is hidden, no more", kind="flag"),
        Column("wrong_name", "a cause that is not there is named", kind="flag"),
        Column("reduction", "part of the held-out error removed"),
    )

    def decides(self, setup: Setup) -> Mapping[str, Any]:
        """Return the text of the judged model and the plan's configuration."""
        own = _Settings.of(setup.settings)
        nominal = _nominal(own, setup)
        plan = _plan(own)
        bench = SimBench(_with(setup.nominal, own), 0)
        estimate(plan, bench)
        _names(nominal, bench)
        return {"nominal": dump_model(nominal), **plan.configuration()}

    def run(self, setup: Setup) -> Mapping[str, Scalar]:
        """Hide, play, diagnose."""
        from analysis.diagnosis.pipeline import Options, diagnose  # heavy, and only these trials need it

        own = _Settings.of(setup.settings)
        nominal = _nominal(own, setup)
        bench = SimBench(_with(setup.bench, own), setup.seed, substeps=own.substeps)
        record = play_in_memory(_plan(own), bench)
        options = Options(
            tolerance=own.tolerance,
            false_alarm=own.false_alarm,
            max_effects=own.max_effects,
            workers=1,
            seed=setup.seed,
        )
        found = diagnose(_dataset(record, *_names(nominal, bench)).seen_by(nominal), nominal, options)
        hidden = own.effect()
        truth = set() if hidden.is_neutral() else {(hidden.reported(), hidden.where)}
        named = {(cause.effect, cause.where) for cause in found.causes}
        return {
            "verdict": found.verdict,
            "seen": found.verdict != "consistent",
            "right": named == truth and found.verdict == ("named" if truth else "consistent"),
            "wrong_name": bool(named - truth),
            "reduction": None if found.gain is None else found.gain.reduction,
        }


def _nominal(own: _Settings, setup: Setup) -> Model:
    return setup.nominal if own.nominal is None else load_model(own.nominal)


def _with(model: Model, own: _Settings) -> Model:
    effect_class(own.hidden.effect)
    return msgspec.structs.replace(model, effects=[*model.effects, own.hidden])


def _plan(own: _Settings) -> Plan:
    return make_plan(own.plan, dict(own.plan_settings))


def _names(nominal: Model, bench: Bench) -> tuple[list[str], list[str]]:
    """Return the channels of the model's inputs and outputs; raises ConfigError for one that the bench lacks."""
    found = []
    for role, ports in (("input", nominal.inputs), ("output", nominal.outputs)):
        have = {s.dof: s.name for s in bench.signals if s.role == role}
        for port in ports:
            if port.dof not in have:
                raise ConfigError(
                    f"the bench of the study has no {role} of {port.dof}, as model '{nominal.name}' has; its {role}s "
                    f"are of {', '.join(have)}: judge a model of this bench"
                )
        found.append([have[port.dof] for port in ports])
    return found[0], found[1]


def _dataset(record: Recording, inputs: list[str], outputs: list[str]) -> Dataset:
    """Return the record as a log of it would be diagnosed: unbroken, every segment a window, some held out."""
    from analysis.diagnosis.records.dataset import Dataset, Record, Window
    from analysis.diagnosis.records.holding import with_held_out

    windows = []
    for segment in record.segments:
        period = segment.settings.get("period_samples", 0)
        whole = int(period) if isinstance(period, int | float) and 1 < period <= segment.rows else 0
        windows.append(Window(segment.label, segment.start, segment.stop, segment.held_out, whole))
    u, y = (np.stack([record.read(name) for name in names], axis=1) for names in (inputs, outputs))
    held, _ = with_held_out([Record(str(record.path), u, y, tuple(windows))])
    return Dataset(record.sample_rate_hz, held)
