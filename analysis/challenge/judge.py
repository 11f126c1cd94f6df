"""What one diagnosis is worth against the truth of its case: reads `diagnosis.json`, nothing else of the diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec

from analysis.challenge.run import DIAGNOSIS, RESULTS, Outcome, outcome_of
from analysis.challenge.truth import Buried, Case
from sim_backend.documents import json_of, read_text
from sim_backend.effects import effect_class
from sim_backend.errors import ConfigError, DataError, MccdError
from sim_backend.small_files import STATE_BYTES

Verdict = Literal["consistent", "named", "ambiguous", "unknown", "failed"]


class _Number(msgspec.Struct):
    value: float | None = None
    std: float | None = None


class _Cause(msgspec.Struct):
    effect: str
    where: str
    probability: float
    parameters: dict[str, _Number]
    posterior: float | None = None


class _Gain(msgspec.Struct):
    rms_after: float | None = None


class _Said(msgspec.Struct):
    """What is read of a diagnosis, and has to be so in one that counts."""

    verdict: Literal["consistent", "named", "ambiguous", "unknown"]
    causes: list[_Cause] = []
    ambiguous: list[list[str]] = []
    gain: _Gain | None = None


@dataclass(frozen=True)
class Judged:
    """One case and what was said of it.

    `found` holds, per hidden effect, whether it was named at its location or rightly called indistinguishable;
    `by_name` whether it was named outright. `wrong` are the names that are not in the truth; `stated` holds, per name,
    its probability and whether it is in the truth. `pulls` are errors of parameters in their stated standard
    deviations, by effect, `without_std` the number of those that none was stated for; `spreads` are the stated
    variances and `misses` the squared errors, both over the Cramér–Rao bound; `held_out` is the error after over that
    of the truth, None when it was not right. `remainder` tells whether a lack of fit was stated beside the names, None
    of a diagnosis that does not say. `posteriors` holds, per name that is hidden or wrong, its posterior and whether it
    is in the truth.
    """

    name: str
    case: Case
    outcome: Outcome
    verdict: Verdict
    found: tuple[bool, ...]
    by_name: tuple[bool, ...]
    wrong: tuple[tuple[str, str], ...]
    stated: tuple[tuple[float, bool], ...]
    pulls: tuple[float, ...]
    without_std: int
    spreads: tuple[float, ...]
    misses: tuple[float, ...]
    held_out: float | None
    remainder: bool | None = None
    posteriors: tuple[tuple[float, bool], ...] = ()

    @property
    def right(self) -> bool:
        """Whether every hidden effect was found and nothing was named wrongly; granted names do not count."""
        return all(self.found) and not self.wrong

    @property
    def noticed(self) -> bool:
        """Whether it was said that the simulation is wrong."""
        return self.verdict in ("named", "ambiguous", "unknown")


def judge(folder: Path, name: str, case: Case) -> Judged:
    """Return what the diagnosis of one case is worth; one that cannot be read counts as *failed*: nothing found."""
    outcome = outcome_of(folder, name)
    said = _read(folder / RESULTS / name / DIAGNOSIS)
    if said is None:
        nothing = tuple(False for _ in case.effects)
        return Judged(name, case, outcome, "failed", nothing, nothing, (), (), (), 0, (), (), None)
    causes = {(_cause(c["effect"]), c["where"]): c for c in said.get("causes", [])}
    groups = [{_cause(n) for n in group} for group in said.get("ambiguous", [])]
    truth = [(effect.effect, effect.where) for effect in case.effects]
    by_name = tuple(key in causes for key in truth)
    found = tuple(named or _tied(e, groups) for e, named in zip(case.effects, by_name, strict=True))
    granted = set(case.granted)
    wrong = tuple(key for key in causes if key not in truth and key not in granted)
    pairs = [
        (causes[key]["parameters"], effect) for key, effect in zip(truth, case.effects, strict=True) if key in causes
    ]
    compared = [row for parameters, effect in pairs for row in _compared(parameters, effect)]
    return Judged(
        name=name,
        case=case,
        outcome=outcome,
        verdict=said["verdict"],
        found=found,
        by_name=by_name,
        wrong=wrong,
        stated=tuple((float(cause["probability"]), key not in wrong) for key, cause in causes.items()),
        pulls=tuple(row[0] for row in compared if row[0] is not None),
        without_std=sum(row[0] is None for row in compared),
        spreads=tuple(row[1] for row in compared if row[1] is not None),
        misses=tuple(row[2] for row in compared if row[2] is not None),
        held_out=_held_out(said, case) if by_name and all(by_name) and not wrong else None,
        remainder=said["remainder"] is not None if "remainder" in said else None,
        # what is granted is there in every case of its kind, and says nothing of how sure a name is
        posteriors=tuple(
            (float(cause["probability"] if cause.get("posterior") is None else cause["posterior"]), key not in wrong)
            for key, cause in causes.items()
            if key not in granted or key in truth
        ),
    )


def _read(path: Path) -> dict[str, Any] | None:
    try:
        text = read_text(path, "diagnosis", most_bytes=STATE_BYTES, error=DataError)
        said: dict[str, Any] = json_of(text, str(path), error=DataError)
        msgspec.convert(said, _Said)
    except (MccdError, msgspec.ValidationError):
        return None
    return said


def _cause(name: str) -> str:
    """Return the cause that an effect is reported by: several effects of the library may share one."""
    try:
        return effect_class(name).reported()
    except ConfigError:
        return name


def _tied(effect: Buried, groups: list[set[str]]) -> bool:
    """Tell whether the effect was called indistinguishable from its twins and from nothing else."""
    twins = {slug for slug, _ in effect.twins}
    return any(effect.effect in group and len(group) > 1 and group <= twins | {effect.effect} for group in groups)


def _compared(parameters: Mapping[str, Any], effect: Buried) -> list[tuple[float | None, float | None, float | None]]:
    """Return (pull, stated variance over bound, squared error over bound) of each parameter that both name.

    A parameter without a value or without a positive standard deviation has no pull.
    """
    rows = []
    for name, true in effect.parameters.items():
        if name not in parameters:
            continue
        value, std = (parameters[name].get(key) for key in ("value", "std"))
        error = None if value is None else float(value) - true.value
        rows.append(
            (
                error / std if error is not None and std else None,
                (std / true.bound_std) ** 2 if std and true.bound_std else None,
                (error / true.bound_std) ** 2 if error is not None and true.bound_std else None,
            )
        )
    return rows


def _held_out(said: Mapping[str, Any], case: Case) -> float | None:
    gain = said.get("gain") or {}
    after = gain.get("rms_after")
    return float(after) / case.held_out_floor if after is not None and case.held_out_floor > 0.0 else None
