"""A diagnosis as files: `diagnosis.json` by docs/diagnosis.md, and `extended.toml`, also given as a difference."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from analysis.diagnosis.answer.changes import Change, changes
from analysis.diagnosis.answer.surety import next_steps
from analysis.diagnosis.records.loading import Source
from analysis.diagnosis.result import Cause, Diagnosis, Domain
from campaigns.version import tool_version
from sim_backend.assembly import coordinates_of
from sim_backend.effects import effect_class
from sim_backend.effects.base import Effect, Site
from sim_backend.effects.sensor_offset import SensorOffset
from sim_backend.errors import ConfigError
from sim_backend.linear import Array, ModalModel
from sim_backend.model import EffectEntry, Mode, Model, Quantity, Value, dump_model, number
from sim_backend.safe_write import write_text

if TYPE_CHECKING:
    from analysis.diagnosis.evidence.chop_gain import ChopGain


SCHEMA = "mccd-diagnosis/1"

DOMAINS = ("frequency", "amplitude", "position", "direction", "rate", "time", "temperature")
"""The domains of the contract; a diagnosis may look at further ones, which follow."""

GAINS = ("held_out", "rms_given", "rms_before", "rms_after", "noise_floor", "reduction", "ci95")
"""Fields of a gain in `gain`; its segments and outputs follow as lists of their own."""

LISTED_RUNS = 4
"""Runs that are named with their checksum in each parameter's source; diagnosis.json has all of them."""


def document(
    diagnosis: Diagnosis, model: Model, sources: Sequence[Source], chops: Sequence[ChopGain] = ()
) -> dict[str, Any]:
    """Return the content of `diagnosis.json`: plain dicts, lists, finite numbers and None.

    `model` is the one that was diagnosed; `chops` are what the feed-forward gained on a bench, where that was tried.
    """
    gain, next_experiment = diagnosis.gain, diagnosis.next_experiment
    names = [*DOMAINS, *(d for d in diagnosis.evidence if d not in DOMAINS)]
    return _plain(
        {
            "schema": SCHEMA,
            "verdict": diagnosis.verdict,
            "sentence": diagnosis.sentence,
            "causes": [_cause(c) for c in diagnosis.causes],
            "ambiguous": [list(tied) for tied in diagnosis.ambiguous],
            "remainder": None if diagnosis.remainder is None else vars(diagnosis.remainder),
            "evidence": {name: _evidence(diagnosis.evidence.get(name, ())) for name in names},
            "gain": None if gain is None else {name: getattr(gain, name) for name in GAINS},
            "next_experiment": None if next_experiment is None else vars(next_experiment),
            "inputs": [{"file": s.file, "sha256": s.sha256} for s in sources],
            "notes": list(diagnosis.notes),
            "segments": [vars(one) for one in gain.segments] if gain else [],
            "outputs": [vars(one) for one in gain.outputs] if gain else [],
            "chops": [vars(chop) for chop in chops],
            "sensitivity": [vars(one) for one in diagnosis.sensitivity],
            "considered": [{"hypothesis": name, "log_odds": value} for name, value in diagnosis.considered],
            "next_steps": list(next_steps(diagnosis)),
            "tolerance": diagnosis.tolerance,
            "parameters": [
                {
                    "place": one.place,
                    "name": one.what,
                    "given": one.before,
                    "adjusted": one.adjusted,
                    "extended": one.after,
                    "std": one.std,
                    "unit": one.unit,
                }
                for one in model_changes(diagnosis, model, sources)
            ],
        }
    )


def _cause(cause: Cause) -> dict[str, Any]:
    blind = cause.blind
    parameters = {n: {"value": p.value, "std": p.std, "unit": p.unit} for n, p in cause.parameters.items()}
    return {
        "effect": cause.effect,
        "where": cause.where,
        "probability": cause.probability,
        "posterior": cause.posterior,
        "blind": None if blind is None else {"names": blind.names, "right": blind.right, "ci95": blind.interval},
        "parameters": parameters,
        "why": cause.why,
    }


def _evidence(domains: Sequence[Domain]) -> dict[str, Any]:
    """Return the least p-value (times the number of curves looked at), its sentence, and every curve."""
    if not domains:
        return {}
    worst = min(domains, key=lambda d: d.p_value)
    return {
        "p_value": min(1.0, worst.p_value * len(domains)),
        "where": worst.where,
        "curves": [
            {
                "record": d.record,
                "output": d.output,
                "unit": d.unit,
                "axis": d.axis.tolist(),
                "level": d.level.tolist(),
                "floor": d.floor.tolist(),
                "p_value": d.p_value,
                "where": d.where,
            }
            for d in domains
        ],
    }


def _plain(node: Any) -> Any:
    """Return `node` as JSON can hold it: numbers that are not finite become None, tuples lists."""
    if isinstance(node, dict):
        return {str(k): _plain(v) for k, v in node.items()}
    if isinstance(node, list | tuple):
        return [_plain(v) for v in node]
    if isinstance(node, np.ndarray | np.generic):
        return _plain(node.tolist())
    if isinstance(node, float):
        return node if math.isfinite(node) else None
    return node


def extended_model(model: Model, diagnosis: Diagnosis, sources: Sequence[Source]) -> Model:
    """Return `model` with its linear part as adjusted and the found effects added, each changed number with its origin.

    Numbers that the fit did not change keep their own origin. Effects of `model` that act on its linear part are in the
    adjusted modes and delays already. `dump_model`, `load_model` and every bench accept the result.
    """
    source = _provenance(sources)
    linear, std = diagnosis.linear, diagnosis.linear_std
    kept = [
        _moved_zero(e, model, diagnosis, source) for e in model.effects if effect_class(e.effect).site is not Site.MODEL
    ]
    nominal = [*model.modes, *_further_modes(model, linear)]
    return msgspec.structs.replace(
        model,
        name=f"{model.name}-extended",
        title=f"{model.title or model.name}, extended by diagnosis".strip(),
        modes=[_mode(mode, m, model, linear, std, source) for m, mode in enumerate(nominal)],
        effects=[*kept, *_entries(diagnosis, source)],
        feedthrough=_feedthrough(model, linear, std, source),
        delay_s=_delays(model, linear, std, source),
        coordinates=model.coordinates | _coordinates(model, diagnosis.effects),
    )


def adjusted_model(model: Model, diagnosis: Diagnosis) -> Model | None:
    """Return `model` with its own numbers fitted and nothing added; None where those are not known."""
    if diagnosis.adjusted is None:
        return None
    bare = replace(diagnosis, linear=diagnosis.adjusted, linear_std=None, effects=(), causes=(), zeros={})
    return extended_model(model, bare, ())


def model_changes(diagnosis: Diagnosis, model: Model, sources: Sequence[Source]) -> list[Change]:
    """Return the numbers in which the adjusted or the extended model differ from the one that was diagnosed."""
    return changes(model, extended_model(model, diagnosis, sources), adjusted_model(model, diagnosis))


def _moved_zero(entry: EffectEntry, model: Model, diagnosis: Diagnosis, source: str) -> EffectEntry:
    """Return an effect of the model as it is, a zero that was fitted beside what the model lacks where it is now."""
    outputs = [port.dof for port in model.outputs]
    at = outputs.index(entry.where) if entry.where in outputs else -1
    if entry.effect != SensorOffset.name or at not in diagnosis.zeros:
        return entry
    off, std = diagnosis.zeros[at]
    now = {n: _fitted(value, number(value) + off, std, source) for n, value in entry.parameters.items()}
    return msgspec.structs.replace(entry, parameters=now)


def _delays(model: Model, linear: ModalModel, std: ModalModel | None, source: str) -> dict[str, Value]:
    """Return the delay of each input; the file must also contain what the model's own effects add to it."""
    delays, sum_of = dict(model.delay_s), f"delay of {model.name} with its effects"
    for j, port in enumerate(model.inputs):
        before, now = delays.get(port.name, 0.0), float(linear.delay_s[j])
        if std is not None and std.delay_s[j] > 0.0:
            delays[port.name] = _fitted(before, now, std.delay_s[j], source)
        elif not math.isclose(number(before), now, rel_tol=1e-12, abs_tol=0.0):
            delays[port.name] = Quantity(value=now, origin="derived", source=sum_of)
    return delays


def _coordinates(model: Model, effects: Sequence[Effect]) -> dict[str, dict[str, Value]]:
    """Return the motion that each effect on an input without a sensor of its own worked against in the fit.

    It follows from the static gain, which the fit has changed since.
    """
    outputs = [p.dof for p in model.outputs]
    rows, source = coordinates_of(model), f"static gain of {model.name}"
    return {
        port.dof: {
            out.name: Quantity(value=float(w), origin="derived", source=source)
            for out, w in zip(model.outputs, rows[j], strict=True)
        }
        for j, port in enumerate(model.inputs)
        if port.dof not in outputs and port.dof in {e.where for e in effects}
    }


def _further_modes(model: Model, linear: ModalModel) -> list[Mode]:
    """Return empty modes for what the model's own effects add to its linear part, every port present."""
    ins, outs = {p.name: 0.0 for p in model.inputs}, {p.name: 0.0 for p in model.outputs}
    return [
        Mode(
            label=f"added {k + 1}",
            frequency_hz=0.0,
            decay_rate_1_s=0.0,
            input=dict(ins),
            output=dict(outs),
            input_direct=dict(ins),
            output_rate=dict(outs),
        )
        for k in range(linear.n_blocks - len(model.modes))
    ]


def _provenance(sources: Sequence[Source]) -> str:
    named = [f"run {s.run_uid} (sha256 {s.sha256})" for s in sources[:LISTED_RUNS]]
    more = f" and {len(sources) - LISTED_RUNS} more in diagnosis.json" if len(sources) > LISTED_RUNS else ""
    return f"mccd {tool_version()} diagnose, fitted to {', '.join(named) or 'arrays'}{more}"


def _feedthrough(model: Model, linear: ModalModel, std: ModalModel | None, source: str) -> dict[str, dict[str, Value]]:
    """Return the direct paths that `model` has, as adjusted."""
    ins, outs = [p.name for p in model.inputs], [p.name for p in model.outputs]
    return {
        out: _table(row, ins, linear.d[outs.index(out)], None if std is None else std.d[outs.index(out)], source)
        for out, row in model.feedthrough.items()
    }


def _table(old: dict[str, Value], names: list[str], row: Array, spread: Array | None, source: str) -> dict[str, Value]:
    at = {n: names.index(n) for n in old}
    return {n: _fitted(v, row[at[n]], None if spread is None else spread[at[n]], source) for n, v in old.items()}


def _fitted(old: Value, new: float, spread: Any, source: str) -> Value:
    """Return a number with its new value, origin and standard deviation; unchanged where nothing adjusted it."""
    if math.isclose(number(old), float(new), rel_tol=1e-12, abs_tol=0.0):
        return old
    known = float(spread) if spread is not None and spread > 0.0 else None  # no nuisance adjusted it: not known
    return Quantity(value=float(new), origin="fitted", source=source, std=known)


def _mode(mode: Mode, m: int, model: Model, linear: ModalModel, std: ModalModel | None, source: str) -> Mode:
    ins, outs = [p.name for p in model.inputs], [p.name for p in model.outputs]

    def of(name: str) -> tuple[Array, Array | None]:
        value = getattr(linear, name)
        pick = (slice(None), m) if name in ("c", "c_rate") else (m,)
        return value[pick], None if std is None else getattr(std, name)[pick]

    turn = 2.0 * math.pi
    (omega, omega_std), (sigma, sigma_std) = of("omega_rad_s"), of("sigma_1_s")
    hz_std = None if omega_std is None else omega_std / turn
    return msgspec.structs.replace(
        mode,
        frequency_hz=_fitted(mode.frequency_hz, float(omega) / turn, hz_std, source),
        decay_rate_1_s=_fitted(mode.decay_rate_1_s, float(sigma), sigma_std, source),
        input=_table(mode.input, ins, *of("b"), source),
        input_direct=_table(mode.input_direct, ins, *of("b_direct"), source),
        output=_table(mode.output, outs, *of("c"), source),
        output_rate=_table(mode.output_rate, outs, *of("c_rate"), source),
    )


def _entries(diagnosis: Diagnosis, source: str) -> list[EffectEntry]:
    """Return the found effects; several of one kind at one location are in the order of their causes."""
    left, entries = list(diagnosis.causes), []
    for effect in diagnosis.effects:
        cause = next((c for c in left if (c.effect, c.where) == (effect.reported(), effect.where)), None)
        if cause is not None:
            left.remove(cause)
        entries.append(_entry(effect, cause, source))
    return entries


def _entry(effect: Effect, cause: Cause | None, source: str) -> EffectEntry:
    parameters: dict[str, Value] = {}
    for p in effect.parameters():
        value = float(getattr(effect, p.name))
        if not math.isfinite(value):
            continue  # neutral at infinity, which is also the default
        estimate = cause.parameters.get(p.name) if cause else None
        if p.fixed:
            parameters[p.name] = Quantity(
                value=value, origin="assumed", source="constant of the description, not fitted"
            )
            continue
        known = estimate.std if estimate is not None and math.isfinite(estimate.std) else None
        parameters[p.name] = Quantity(value=value, origin="fitted", source=source, std=known)
    note = cause.why if cause else "part of a hypothesis that the data do not single out"
    return EffectEntry(effect=effect.name, where=effect.where, parameters=parameters, note=note)


def prepare_folder(out: Path) -> Path:
    """Return the folder `out`, made if need be, before work is done for it; raises ConfigError when it cannot be."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{out} cannot be made a folder ({error.strerror}); choose another --out") from None
    if not os.access(out, os.W_OK):
        raise ConfigError(f"{out} is read-only; choose another --out")
    return out


def write_extended(diagnosis: Diagnosis, model: Model, sources: Sequence[Source], out: Path) -> Path:
    """Write `extended.toml` into the folder `out`, whole or not at all, and return its path."""
    return write_text(out / "extended.toml", dump_model(extended_model(model, diagnosis, sources)))


def write_files(
    diagnosis: Diagnosis, model: Model, sources: Sequence[Source], out: Path, chops: Sequence[ChopGain] = ()
) -> dict[str, Path]:
    """Write `extended.toml` and `diagnosis.json` into the folder `out` and return their paths; each appears whole.

    `diagnosis.json` comes last: where it stands, all is there. Raises OSError, naming the file, when a disk is full.
    """
    text = json.dumps(document(diagnosis, model, sources, chops), indent=2, ensure_ascii=False, allow_nan=False)
    return {
        "extended.toml": write_extended(diagnosis, model, sources, out),
        "diagnosis.json": write_text(out / "diagnosis.json", text + "\n"),
    }
