"""The one sentence with which a diagnosis opens: what is wrong, why, how sure, what fixing it gained."""

from __future__ import annotations

from collections.abc import Sequence

from analysis.diagnosis.result import Cause, Choice, Gain, Verdict
from analysis.pages.quantities import share


def sentence(
    verdict: Verdict,
    causes: Sequence[Cause],
    tied: Sequence[Sequence[str]],
    gain: Gain | None,
    choice: Choice | None = None,
) -> str:
    """Return the sentence for a verdict; with `choice` a second one says what to do next, or why nothing helps."""
    return " ".join(filter(None, (_verdict(verdict, causes, tied, gain), _next(choice))))


def _next(choice: Choice | None) -> str:
    if choice is None:
        return ""
    if choice.experiment is None:
        return f"{choice.reason[0].upper()}{choice.reason[1:]}."
    plan = choice.experiment
    return (
        f"The plan {plan.test} would tell {' from '.join(plan.separates)}: after {plan.duration_s:.3g} s they would "
        f"differ by {plan.expected_sigma:.2g} sigma."
    )


def _verdict(verdict: Verdict, causes: Sequence[Cause], tied: Sequence[Sequence[str]], gain: Gain | None) -> str:
    if verdict == "consistent":
        return "The simulation is consistent with the data: what it leaves is noise."
    if verdict == "unknown":
        return "The simulation is wrong, and no effect in the library explains how; the evidence shows where it lives."
    listed = " and ".join(f"{c.effect} at {c.where}" for c in causes)
    if verdict == "ambiguous":
        choice = " or ".join(", ".join(group) for group in tied)
        start = f"The simulation lacks {listed}, and" if listed else "The simulation is wrong, but"
        return f"{start} these data cannot tell which of {choice} it is."
    sure = min((c.probability for c in causes), default=0.0)
    text = f"The simulation lacks {listed} (probability {sure:.1%}): {causes[0].why}"
    if gain is not None:
        before, after = share(gain.rms_before), share(gain.rms_after)
        text += f"; adding it takes the held-out error from {before} to {after} of the output"
    return f"{text}."
