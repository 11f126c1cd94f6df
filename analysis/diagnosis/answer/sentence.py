"""A diagnosis in words: the sentence with which it opens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from analysis.diagnosis.result import Cause, Choice, Domain, Gain, Remainder, Verdict, hypothesis_text
from analysis.diagnosis.verdict.held_out import ABOVE_NOISE, leaves_most
from analysis.diagnosis.verdict.lack_of_fit import ONE_IN_A_MILLION
from analysis.diagnosis.verdict.outstanding import least_by_chance
from analysis.pages.formats import readable, without_exponents
from analysis.pages.quantities import certainty, chance, share
from sim_backend.effects.words import effect_text
from sim_backend.modes import is_mode

SIGNIFICANT = 1e-3
"""Evidence with a larger p-value, counted over all curves of its domain, is not spoken of."""

_MANY = 4
"""Up to so many locations of one kind of cause are all listed."""


def sentence(
    verdict: Verdict,
    causes: Sequence[Cause],
    tied: Sequence[Sequence[str]],
    gain: Gain | None,
    evidence: Mapping[str, Sequence[Domain]],
    choice: Choice | None = None,
    remainder: Remainder | None = None,
) -> str:
    """Return the sentence for a verdict; further ones state the residual beside a name, and with `choice` what to do.

    An unknown verdict also states the `evidence`: where the unexplained residual is.
    """
    parts = (
        _verdict(verdict, causes, tied, gain, evidence),
        _left(remainder),
        _allowed(verdict, gain, remainder),
        _next(choice),
    )
    return without_exponents(" ".join(filter(None, parts)))


def _left(remainder: Remainder | None) -> str:
    if remainder is None:
        return ""
    return (
        f"It is not all: {share(remainder.share)} of the squared error above noise stays unexplained "
        f"({remainder.lives}; {chance(remainder.significance)})."
    )


def _next(choice: Choice | None) -> str:
    if choice is None:
        return ""
    if choice.experiment is None:
        return f"{choice.reason[0].upper()}{choice.reason[1:]}."
    plan = choice.experiment
    return (
        f"The plan {plan.test} would distinguish {' from '.join(map(hypothesis_text, plan.separates))}: after "
        f"{readable(plan.duration_s)} s they "
        f"would differ by {readable(plan.expected_sigma, 2)} sigma."
    )


def _verdict(
    verdict: Verdict,
    causes: Sequence[Cause],
    tied: Sequence[Sequence[str]],
    gain: Gain | None,
    evidence: Mapping[str, Sequence[Domain]],
) -> str:
    if verdict == "consistent":
        return f"The simulation is consistent with the data: the residual is noise{_little(gain)}."
    if verdict == "unknown":
        lives = _where_it_lives(evidence)
        return f"The simulation is wrong, and no effect in the library explains how{lives}{_missed(gain)}."
    lacking = listed(causes)
    sure = f" (probability {certainty(min((c.probability for c in causes), default=0.0))}"
    sure += " each)" if len(causes) > 1 else ")"
    if verdict == "ambiguous":
        choice = " or ".join(", ".join(map(effect_text, group)) for group in tied)
        start = f"The simulation lacks {lacking}{sure}, and" if lacking else "The simulation is wrong, but"
        return f"{start} these data do not show which of {choice} it is{_gained(gain, 'the best of them')}."
    why = "; ".join(dict.fromkeys(c.why for c in causes))
    return f"The simulation lacks {lacking}{sure}: {why}{_gained(gain, 'it' if len(causes) == 1 else 'them')}."


def listed(causes: Sequence[Cause]) -> str:
    """Return what the causes are and where, each kind once; of many locations how many they are."""
    places: dict[str, list[str]] = {}
    for cause in causes:
        places.setdefault(cause.effect, []).append(cause.where)
    parts = []
    for slug, where in places.items():
        effect = effect_text(slug)
        if len(where) > _MANY:
            parts.append(f"{effect} at {len(where)} {'modes' if all(map(is_mode, where)) else 'locations'}")
        else:
            parts.append(f"{effect} at {' and '.join(filter(None, (', '.join(where[:-1]), where[-1])))}")
    return (", and " if len(parts) < len(causes) else " and ").join(parts)


def _gained(gain: Gain | None, what: str) -> str:
    if gain is None:
        return ""
    before, after = share(gain.rms_before), share(gain.rms_after)
    if gain.measurable and gain.rms_after > gain.rms_before:
        grows = f"; with {what} the held-out error grows from {before} to {after} of the output"
        if not gain.rms_after > ABOVE_NOISE * gain.noise_floor:
            return f"{grows}, of which {share(gain.noise_floor)} is noise"
        size = f"{readable(gain.times, 2)} ± {readable(gain.times_std, 1)}"
        return (
            f"{grows}, but slow noise is part of it: allowing for that, these samples fit {size} "
            "times the added effect best"
        )
    if gain.measurable:
        return (
            f"; adding {what} takes the held-out error from {before} (the model's own numbers adjusted) to {after} of "
            "the output"
        )
    return (
        f"; what adding {what} gains on the held-out samples is less than its uncertainty (error "
        f"{before} of the output "
        f"before, {after} after, of which {share(gain.noise_floor)} is noise)"
    )


def _missed(gain: Gain | None) -> str:
    if gain is None:
        return ""
    missed = f"; it misses {share(gain.rms_before)} of the held-out output"
    if not gain.noise_floor < gain.rms_before:  # noise estimated from the residual: its size says nothing
        return f"{missed}, which by its size alone could all be noise"
    return f"{missed}, of which {share(gain.noise_floor)} is noise"


def _little(gain: Gain | None) -> str:
    """Return how much of the output is absorbed by noise where it is most of it, or by the parameters' uncertainty."""
    if gain is None:
        return ""
    if leaves_most(gain):
        return (
            f", and that is {share(gain.rms_before)} of the held-out output: these data say little about the simulation"
        )
    above = _above_usual(gain)
    return f", and on held-out samples it misses {above}" if above else ""


def _allowed(verdict: Verdict, gain: Gain | None, remainder: Remainder | None) -> str:
    """Return the residual of the named causes above the usual noise, if large, and why it is not a lack of fit."""
    if verdict not in ("named", "ambiguous") or remainder is not None or gain is None:
        return ""
    above = _above_usual(gain)
    return f"On held-out samples it still misses {above}." if above else ""


def _above_usual(gain: Gain) -> str:
    """Return the residual on held-out samples above the usual noise; empty where there is none."""
    if not gain.rms_after > ABOVE_NOISE * gain.noise_floor:
        return ""
    return (
        f"{share(gain.rms_after)} where {share(gain.noise_floor)} is usual, no more than slow noise and what is "
        "uncertain of its own numbers allow"
    )


def reservation(verdict: Verdict, evidence: Mapping[str, Sequence[Domain]]) -> str:
    """Return what a reader of a *consistent* verdict has to know: where the residual is not steady noise."""
    least = least_by_chance(evidence) if verdict == "consistent" else None
    if least is None or not least[0] * len(evidence) < ONE_IN_A_MILLION:
        return ""
    p, name, curve = least
    return (
        f"no effect of the library explains more than noise may, yet the residual is not steady noise: by {name}, "
        f"{curve.where} ({chance(p)}); its size may follow the excitation or change with time"
    )


def _where_it_lives(evidence: Mapping[str, Sequence[Domain]]) -> str:
    """Return the domain in which the residual is most significant, and where in it; nothing if nowhere."""
    least = least_by_chance(evidence)
    if least is None:
        return ""
    p, name, curve = least
    if not p < SIGNIFICANT:
        return "; see the remarks for the residual"
    return f"; its residual is most significant by {name}, {curve.where} ({chance(p)})"
