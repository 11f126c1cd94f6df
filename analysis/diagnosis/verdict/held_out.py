"""Held-out validation: what held-out samples and evidence say against a verdict that the search has reached.

Where nothing repeats the noise is estimated from the residual of the model. The residual of a model that explains
nothing is everything, and no search finds more than noise in that; causes that fit the fitted samples and no others are
overfitted. Samples that no fit has seen show both. Noise that a bench has by itself is steady: what is unsteady, and is
most of the output, is not taken for noise. Where periods repeat, neither is any whose size follows the excitation.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.records.dataset import Dataset
from analysis.diagnosis.result import SELDOM, Domain, Gain, Remainder
from analysis.diagnosis.verdict.judging import Judgement
from analysis.diagnosis.verdict.lack_of_fit import ONE_IN_A_MILLION
from analysis.diagnosis.verdict.outstanding import least_by_chance
from sim_backend.linear import Array

_MOST = 0.5
"""Part of a sum of squares that is most of it: the residual of the output, or a staircase of the residual."""

ABOVE_NOISE = 1.2
"""Times the noise, as rms, from which on the error on held-out samples is not noise."""

_ABOVE = 2.0
"""Times the noise, as rms, from which on three quarters of the residual in squares are no noise."""

_SURELY = 3.0
"""Standard deviations above which what was added has another size on held-out samples."""

_HALF = 0.5
"""Part of its size below which a change leaves more squares than it takes away: (1 - t)² is above t²."""

_PLAYED = "amplitude", "position", "direction", "rate"
"""Domains of the evidence that depend on the excitation."""


def leaves_most(gain: Gain | None) -> bool:
    """Tell whether the model leaves most of the held-out output."""
    return gain is not None and gain.rms_before**2 > _MOST


def follows_play(evidence: Mapping[str, Sequence[Domain]]) -> bool:
    """Tell whether the residual's size or mean follows the excitation, and no worse than it follows time.

    A shock from outside is large at some time, and so at some position.
    """
    played = _chance(evidence, _PLAYED)
    return played * len(evidence) < ONE_IN_A_MILLION and played <= _chance(evidence, ("time",))


def loses(gain: Gain | None) -> bool:
    """Tell whether the extended model is surely worse on held-out samples than before, and leaves more than noise.

    Of two models that both leave noise, the one that is nearer by chance is no better; nor is it where noise is slow,
    and the other one's residual is the likelier noise and hardly larger.
    """
    if gain is None or not gain.ci95[1] < 0.0:
        return False
    by_chance = gain.likelier and gain.rms_after < ABOVE_NOISE * gain.rms_before
    return gain.rms_after > ABOVE_NOISE * gain.noise_floor and not by_chance


def of_another_size(gain: Gain | None, *, tied: bool = False) -> str:
    """Return in words the size that held-out samples would give to what was added, where that forbids it.

    Below half its size there, what was added misses more than it explains (decision 42): a confounder has its
    size only where it was fitted. A right cause beside others that the model lacks may have any size above that. A tie
    claims that one of its causes acts and nothing else, and that one has its own size everywhere.
    """
    if gain is None:
        return ""
    differs = abs(gain.times - 1.0) > max(ABOVE_NOISE - 1.0, _SURELY * gain.times_std)
    if not (differs if tied else surely_misses(gain.times, gain.times_std)):
        return ""
    return (
        "the best explanation fits only the samples that it was fitted to: on the held-out ones it would "
        f"have to be {gain.times:.2g} ± {gain.times_std:.1g} times as large"
    )


def surely_misses(times: float, std: float) -> bool:
    """Tell whether a change misses more of held-out samples than it explains: they surely want less than half of it.

    `times` its size they want, with that standard deviation.
    """
    return times + _SURELY * std < _HALF


def beyond_noise(gain: Gain | None) -> bool:
    """Tell whether the error on held-out samples is surely no noise alone, nor the error of numbers that were tuned."""
    return gain is not None and gain.least_error > ABOVE_NOISE * max(gain.noise_floor, gain.most_noise)


def _chance(evidence: Mapping[str, Sequence[Domain]], domains: Collection[str]) -> float:
    """Return the chance of the most significant curve in these domains; one where they hold nothing."""
    least = least_by_chance({name: curves for name, curves in evidence.items() if name in domains})
    return least[0] if least else 1.0


def validated(judgement: Judgement, gain: Gain | None, repeats: bool, unsteady: str, played: bool = False) -> Judgement:
    """Return `judgement`, or *unknown* with the reason where held-out samples or evidence speak against it.

    `repeats` tells whether noise is known from repetitions, `unsteady` says in words where the residual is not steady
    noise (empty where it is), and `played` whether it follows the excitation. A *consistent* model must not leave most
    of the output as unsteady noise, nor anything that follows the excitation, nor more than noise on held-out samples;
    causes that are *named* must gain something, or leave little beside noise, and lose nothing. Their residual on
    held-out samples beside noise is a lack of fit.
    """
    against, claimed = "", judgement.verdict in ("named", "ambiguous")
    if gain is not None and judgement.verdict == "consistent" and beyond_noise(gain):
        against = f"on held-out samples the model misses {gain.rms_after / gain.noise_floor:.3g} times the noise"
    elif claimed and loses(gain):
        against = "the best explanation predicts the held-out samples worse than the model without it"
    elif (
        claimed and not judgement.remainder and (other := of_another_size(gain, tied=judgement.verdict == "ambiguous"))
    ):
        against = other
    elif repeats:
        against = unsteady if judgement.verdict == "consistent" and played else ""
    elif gain is None:
        return judgement
    elif judgement.verdict == "consistent" and unsteady and leaves_most(gain):
        against = "the model leaves most of the held-out output, and its residual is not steady noise"
    elif judgement.verdict == "consistent" and unsteady and played:
        against = unsteady
    elif judgement.verdict == "named" and not gain.measurable and gain.rms_after > _ABOVE * gain.noise_floor:
        against = (
            "the best explanation fits only the samples that it was fitted to: it gains nothing on the "
            "held-out ones, and leaves more than noise of them"
        )
    if against:
        return replace(judgement, verdict="unknown", named=(), tied=(), failed_check=against, remainder=None)
    if claimed and judgement.remainder is None and beyond_noise(gain):
        return replace(judgement, remainder=_on_held_out(gain))
    return judgement


def _on_held_out(gain: Gain | None) -> Remainder | None:
    """Return the residual on held-out samples beside noise."""
    if gain is None:
        return None
    noise = gain.noise_floor**2
    share = (gain.rms_after**2 - noise) / max(gain.rms_before**2 - noise, np.finfo(float).tiny)
    return Remainder(float(np.clip(share, 0.0, 1.0)), SELDOM, "the held-out samples")


def beside_doubts(judgement: Judgement, data: Dataset, left: Sequence[Array]) -> Judgement:
    """Return `judgement`, or *unknown* where doubts about the records of `data` forbid it.

    They forbid every name; and that what is `left`, (n, n_y) per record, is noise, where most of it is the staircase of
    a sensor that is slower than the log.
    """
    doubts = data.doubts
    most = _MOST * np.mean(np.concatenate(left) ** 2, axis=0)
    if not doubts or (judgement.verdict == "consistent" and not np.any(data.staircase() ** 2 > most)):
        return judgement
    return replace(judgement, verdict="unknown", named=(), tied=(), failed_check="; ".join(doubts), remainder=None)
