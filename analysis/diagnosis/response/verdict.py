"""From fits of a response to a verdict: what is named, what is tied, and when no linear effect is good enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from analysis.diagnosis.response.fits import Fit, Setting
from analysis.diagnosis.response.search import Found
from analysis.diagnosis.result import Cause, Verdict
from analysis.diagnosis.search.adequacy import EXPLAINED
from analysis.diagnosis.search.shortlist import SURE, SURE_LEAD
from analysis.diagnosis.verdict.judging import cause_of, stand_in
from analysis.diagnosis.verdict.leftover import ONE_IN_A_MILLION
from sim_backend.model import Model

_SUREST = 0.999
"""Highest probability that is told: what no hypothesis here holds has a share of its own."""


@dataclass(frozen=True)
class Judged:
    """The verdict with numbers of the named effects, tied names, rivals by evidence, and what speaks against a name."""

    verdict: Verdict
    named: tuple[int, ...]
    tied: tuple[tuple[str, ...], ...]
    probability: float
    rivals: tuple[tuple[str, float], ...]
    objection: str = ""


def judged(setting: Setting, found: Found) -> Judged:
    """Return the verdict on what a search found in lines of one linear response."""
    best = found.best
    against = _objection(setting, found)
    gaps = _gaps(found)
    rivals = tuple(("+".join(label) or "none", -gap) for label, gap in gaps)
    if not best.candidates:
        return Judged("unknown" if against else "consistent", (), (), _SUREST, (), against)
    weights = np.exp(-np.array([gap for _, gap in gaps]))
    probability = float(min(1.0 / (1.0 + weights.sum()), _SUREST))
    if against:
        return Judged("unknown", (), (), probability, rivals, against)
    if probability >= SURE:
        return Judged("named", tuple(range(len(best.effects))), (), probability, rivals)
    own = set(_label(best))
    # the fewest rivals without which it would be sure
    beyond = weights.sum() - np.cumsum(weights)
    close = [set(label) for label, _ in gaps[: 1 + int(np.sum(beyond > np.exp(-SURE_LEAD)))]]
    shared = own.intersection(*close)
    tied = tuple(sorted(set().union(own, *close) - shared))
    sure = tuple(i for i, effect in enumerate(best.effects) if effect.reported() in shared)
    return Judged("ambiguous", sure, (tied,), probability, rivals)


def _label(one: Fit) -> tuple[str, ...]:
    return tuple(sorted({effect.reported() for effect in one.effects}))


def _gaps(found: Found) -> list[tuple[tuple[str, ...], float]]:
    """Return rival names with the evidence by which the best leads, closest first; a part of the best is a rival too.

    What holds all that the best names and more is none: its prior has paid for more than it gained.
    """
    own, gaps = _label(found.best), dict[tuple[str, ...], float]()
    for one in found.fits:
        label = _label(one)
        if not set(own) <= set(label):
            gap = max(found.best.evidence - one.evidence, 0.0)
            gaps[label] = min(gaps.get(label, np.inf), gap)
    return sorted(gaps.items(), key=lambda pair: pair[1])


def _objection(setting: Setting, found: Found) -> str:
    """Return why the best model cannot be the whole truth, in words; nothing where it can."""
    best, n, dof = found.best, 2 * setting.lines.n, setting.noise.dof
    allowed = 4.0 * np.sqrt(2.0 / n + 2.0 / dof) + 0.002
    excess = best.chi2 / n - 1.0
    before = found.tuned.chi2 / n - 1.0
    explained = 1.0 - excess / before if best.candidates and before > 0.0 else 0.0
    if excess > allowed and explained < EXPLAINED:
        gets = f" and explains {100.0 * explained:.4g} % of what was more ({100.0 * EXPLAINED:g} % are asked for)"
        return (
            f"the best linear model{_names(best)} leaves {best.chi2 / n:.3g} times the mean square of the noise, where "
            f"at most {1.0 + allowed:.3g} may be noise{gets if best.candidates else ''}"
        )
    strain, count = float(np.sum(best.white**2)), best.white.size
    if count and scipy.stats.chi2.sf(strain, count) < ONE_IN_A_MILLION:
        return (
            f"the best linear model{_names(best)} needs nominal numbers that are off by "
            f"{np.sqrt(strain / count):.2g} times their tolerance (rms of {count})"
        )
    return stand_in(best)


def _names(best: Fit) -> str:
    return f", with {' and '.join(f'{e.reported()} at {e.where}' for e in best.effects)}," if best.effects else ""


def causes_of(judgement: Judged, best: Fit, model: Model) -> tuple[Cause, ...]:
    """Return the named causes with their parameters in units of the model's ports."""
    return tuple(cause_of(i, best, model, judgement.probability) for i in judgement.named)


def of_levels(remarks: Sequence[str]) -> Judged:
    """Return the verdict on a response that depends on the level: no linear effect makes one, so none is named."""
    words = f"the response depends on the level of excitation, as that of no linear model does: {'; '.join(remarks)}"
    return Judged("unknown", (), (), _SUREST, (), words)
