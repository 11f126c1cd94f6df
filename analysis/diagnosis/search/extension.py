"""A fit with one more effect: where it starts."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.fitting.refit import refit
from analysis.diagnosis.fitting.takeover import part_to_take, taken_over
from analysis.diagnosis.nominal.prior import spreads_of
from analysis.diagnosis.nominal.tuning import reach_of
from sim_backend.effects.base import Site
from sim_backend.errors import ConfigError

Array = NDArray[np.float64]

_TRUSTED = 3.0
"""Refits start with knobs within this many standard deviations of the nominal model."""


def extended(setting: Setting, fit: Fit, candidate: Candidate, sizes: Array, knobs: Array) -> Fit:
    """Return `fit` with one more effect, refitted from its screened `sizes` and the `knobs`' change beside it."""
    before, held = fit.held()
    sd = spreads_of(setting.knobs)
    # knobs that stand in for a missing effect have wandered off; once it is there they belong near the nominal model
    least, most = reach_of(setting.knobs)
    trusted = np.maximum(-_TRUSTED * sd, least), np.minimum(_TRUSTED * sd, most)
    start = np.clip(fit.change + knobs[: fit.change.size], *trusted)
    if candidate.effect.site is Site.MODEL:
        # the effect takes over what the knobs did in its place, at any size; one that cannot be (a delay below zero)
        # is left to the fit
        with suppress(ConfigError):
            sizes = sizes * part_to_take(setting, fit, candidate, sizes)
            start = np.clip(taken_over(setting, fit, candidate, sizes)[0], least, most)
    return refit(setting, (*before, candidate), np.concatenate([held, sizes]), start)
