"""How sure a diagnosis is, what limits it, and what to do next."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from analysis.diagnosis.answer.sentence import SIGNIFICANT, listed
from analysis.diagnosis.calibration import BlindNames
from analysis.diagnosis.result import Cause, Diagnosis, hypothesis_text
from analysis.diagnosis.verdict.outstanding import least_by_chance
from analysis.pages.formats import readable
from analysis.pages.quantities import certainty, chance, share

_FAR_LESS = 5
"""Powers of ten from which on the number before them says nothing more."""


@dataclass(frozen=True)
class Surety:
    """How sure a diagnosis is, what limits the answer, and what to do next; each a list of sentences."""

    how: tuple[str, ...]
    limits: tuple[str, ...]
    steps: tuple[str, ...]


def surety(diagnosis: Diagnosis) -> Surety:
    """Return how sure the answer of a diagnosis is, everything that limits it, and what to do next."""
    far, rival = _rival(diagnosis)
    limits = [] if far else [rival]
    if diagnosis.remainder is not None:
        r = diagnosis.remainder
        limits.append(
            f"{share(r.share)} of the squared error above the noise stays unexplained: {r.lives} "
            f"({chance(r.significance)})."
        )
    if diagnosis.gain is None:
        limits.append("No segment was held out, so the gain could not be tested on data that no fit has seen.")
    limits += map(_capitalised, diagnosis.notes)
    how = [*_how(diagnosis), *([rival] if far else [])]
    return Surety(tuple(how), tuple(filter(None, limits)), tuple(next_steps(diagnosis)))


def next_steps(diagnosis: Diagnosis) -> Iterator[str]:
    """Yield what to do next, one sentence or two each: an experiment, and what would remove a limit of the answer."""
    yield _first_step(diagnosis)
    recorded = bool(diagnosis.data.records)
    if recorded and not diagnosis.data.repeats:
        yield (
            "Play every excitation at least twice and state its period: the noise is then known by itself, and no "
            "error of the model is taken for noise."
        )
    if diagnosis.gain is None:
        yield "Hold out a part of the data, to test the answer on what no fit has seen."
    if not recorded and "level" not in diagnosis.evidence:
        yield "Measure the response at a second level of excitation: what is not linear shows as a difference."


def _first_step(diagnosis: Diagnosis) -> str:
    plan = diagnosis.next_experiment
    if plan is not None:
        return (
            f"Run the experiment proposed below, {plan.test}, and diagnose all records together: it would separate "
            f"{' from '.join(map(hypothesis_text, plan.separates))}."
        )
    if diagnosis.verdict == "consistent":
        return "Use the model at the amplitudes, speeds and frequencies of these data; they say nothing of others."
    if diagnosis.verdict == "unknown" and not diagnosis.data.records:
        return (
            "No experiment is planned. Record the motion over time and diagnose the log: a response does not show "
            "effects that are not linear."
        )
    if diagnosis.verdict == "unknown":
        return (
            "No experiment is planned. Plans are compared by how well they distinguish effects, and no effect of the "
            "library explains this residual. Record the same motion at other amplitudes, speeds and temperatures, one "
            "of them changed at a time: what the residual follows tells what causes it."
        )
    if diagnosis.verdict == "ambiguous" and not diagnosis.data.records:
        return (
            "No experiment is planned from a response. An instrument that does not share the bench's sensors may "
            "distinguish what is tied."
        )
    if diagnosis.verdict == "ambiguous":
        return (
            "No plan of the bench is known to distinguish what is tied; the remarks say why. An instrument that does "
            "not share the bench's sensors may."
        )
    if diagnosis.remainder is not None:
        return (
            "No experiment is planned, for nothing is tied. To see what the unexplained part is, record other "
            "amplitudes and speeds and diagnose them with extended.toml as the model."
        )
    return (
        "No experiment is planned, for nothing is tied. Test the name on new data of other amplitudes and speeds: with "
        "extended.toml as the model their verdict is “consistent” if the cause is right."
    )


def _capitalised(note: str) -> str:
    """Return a note with a capital at its beginning, unless that is the name of a file or the like."""
    first = note.split(maxsplit=1)[0] if note.split() else ""
    return note[0].upper() + note[1:] if first.isalpha() else note


def _how(diagnosis: Diagnosis) -> list[str]:
    alike: dict[tuple[str, str], list[Cause]] = {}
    for cause in diagnosis.causes:
        alike.setdefault((cause.effect, certainty(cause.probability)), []).append(cause)
    said = [
        f"{_capital(listed(causes))}: {'each ' if len(causes) > 1 else ''}{sure} probable."
        for (_, sure), causes in alike.items()
    ]
    said += map(_counted, dict.fromkeys(c.blind for c in diagnosis.causes if c.blind is not None))
    if any(cause.blind is None for cause in diagnosis.causes):
        said.append("A probability below that of the blind cases is that among the effects of the library alone.")
    if diagnosis.verdict == "ambiguous":
        said.append("That the model is wrong is sure; these data do not show which of the tied causes it is.")
    least = least_by_chance(diagnosis.evidence)
    if diagnosis.verdict == "unknown" and least is not None:
        p, name, curve = least
        said.append(f"That the model is wrong: by {name}, {curve.where} ({chance(p)}).")
    if diagnosis.verdict == "consistent" and least is not None:
        p, name, curve = least
        if p >= SIGNIFICANT:
            said.append(f"The residual is most significant by {name}, no more than by chance ({chance(p)}).")
        else:
            said.append(
                f"The residual is most significant by {name}: {curve.where} ({chance(p)}). No effect of the library "
                "explains more than noise may."
            )
    return said


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]


def _counted(blind: BlindNames) -> str:
    low, high = (f"{100.0 * end:.0f}" for end in blind.interval)
    return (
        f"Of {blind.names} such names in blind cases on simulated benches {blind.right} were right (95 %: {low} to "
        f"{high} %). No single record makes a name surer."
    )


def _rival(diagnosis: Diagnosis) -> tuple[bool, str]:
    """Return whether the second-best explanation of what was named is far behind, and what to say of it.

    Nothing where none was weighed.
    """
    if diagnosis.verdict != "named" or not diagnosis.considered:
        return False, ""
    name, evidence = diagnosis.considered[0]
    far = -evidence / math.log(10.0) >= _FAR_LESS + 1
    said = (
        f"Of the explanations compared, the next best, {hypothesis_text(name)}, makes the data {times_less(evidence)} "
        "times less likely"
    )
    if not far:
        return False, f"{said}."
    return True, (
        f"{said}, if the noise is as assumed. That compares effects of the library; the {_stated(diagnosis)} also "
        "allows for causes outside of it."
    )


def _stated(diagnosis: Diagnosis) -> str:
    return certainty(min((c.probability for c in diagnosis.causes), default=0.0))


def times_less(evidence: float) -> str:
    """Return how many times less likely the data are by natural logarithm of the odds: 50, or 10²⁰⁰."""
    power = math.floor(-evidence / math.log(10.0))
    return f"10{_superscript(power)}" if power > _FAR_LESS else readable(math.exp(max(-evidence, 0.0)))


def _superscript(n: int) -> str:
    return str(n).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
