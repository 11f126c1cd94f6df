"""A line or a band: noise in a narrow band looks like a line in a short record, and the band is preferred then."""

from __future__ import annotations

import math
from dataclasses import replace

from analysis.diagnosis.fitting.balance import score
from analysis.diagnosis.fitting.discrepancy import discrepancy_of
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.fitting.refit import refit
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.search.shortlist import SURE_LEAD
from analysis.diagnosis.variance.broadband import noise_evidence
from sim_backend.effects.vibration_line import VibrationLine


def without_lines(found: Found) -> Found:
    """Return the outcome without its vibration lines, where random vibration explains the data as well."""
    best, setting = found.best, found.setting
    rest = without_lines_of(setting, best)
    if rest is best:
        return found
    lost = max(rest.misfit - best.misfit, 0.0)
    explained = max(found.explained - lost, 0.0) if rest.candidates else 0.0
    rivals = tuple(f for f in found.rivals if not any(c.effect is VibrationLine for c in f.candidates))
    return replace(
        found, best=rest, rivals=rivals, explained=explained, discrepancy=discrepancy_of(setting, found.tuned, rest)
    )


def without_lines_of(setting: Setting, best: Fit) -> Fit:
    """Return a fit without its vibration lines, where random vibration explains the data as well.

    A line must exceed the price of its parameters and the margin for a named cause. Where no band is left about it, its
    evidence is that of the samples, against that of a band in its stead. In a band, both are compared by the evidence
    of the spectrum: one of its bins holds many frequencies, of which the line takes the strongest.
    """
    keep = [i for i, c in enumerate(best.candidates) if c.effect is not VibrationLine]
    if len(keep) == len(best.candidates):
        return best
    candidates, sizes = best.held(keep)
    rest = refit(setting, candidates, sizes, best.change, exact=True)
    if not math.isfinite(rest.misfit):
        return best
    beside, instead = noise_evidence(setting, best), noise_evidence(setting, rest)
    lines = [e.frequency_hz for e in best.effects if isinstance(e, VibrationLine)]
    if any(beside.low_hz <= f <= beside.high_hz for f in lines):
        worth = beside.total - instead.total - (best.occam - rest.occam)
    else:
        worth = 0.5 * (score(rest, True) - score(best, True)) + beside.band - instead.band
    return best if worth > SURE_LEAD else rest
