"""Modal effects, which act within the modes, where no channel is: searched for beside a dominant cause.

Joints, ceramics and glue are deformed by every mode in its own proportion, seldom in that of the drives alone. So a
location within the structure is a mode: it is deflected by what it adds to the outputs, and driven by a force of its
own. An effect that changes all modes is searched for in all of them at once, one kind against another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.fitting.refit import refit
from analysis.diagnosis.nominal.responses import simulate
from analysis.diagnosis.search.shortlist import SURE_LEAD
from sim_backend.effects.base import Effect
from sim_backend.effects.cubic_stiffness import CubicStiffness
from sim_backend.effects.view import RecordView
from sim_backend.linear import Array, ModalModel, discretise
from sim_backend.modes import is_mode, mode_alone

Cost = Callable[[Fit], float]
"""Twice the negative logarithm of the evidence of a fit."""

_RIVALS: tuple[type[Effect], ...] = (CubicStiffness,)
"""What a mode may hold instead of what is named there: a stiffness that follows the motion itself, not its level. It
would be a spring between channels that was tried there before."""

_PART = 0.02
"""Part of a mode's stiffness that is the natural size of what happens in it."""

_STEPS = 6
"""Steps of a fit: beside a linear model that was fitted to the same records they are enough."""

_FIRST = 0.3
"""Part of its own size with which a dominant cause starts beside modal effects, which explain most of it."""

_SURE = 3.0
"""A mode takes part where its size is so many standard deviations of what the residual leaves it uncertain by."""


def in_modes(setting: Setting, tuned: Fit, cost: Cost, kinds: Sequence[type[Effect]]) -> Fit | None:
    """Return the best fit of one of `kinds` in the modes; nothing where none pays, or another kind pays as well.

    It has to pay what being sure takes. Where one mode is all there is, a drive acts on nothing else, and what happens
    in it happens at the drive.
    """
    modes = _swinging(setting)
    if len(modes) < 2 or not kinds:
        return None
    within = [[_candidate(setting, kind, m) for m in modes] for kind in (*kinds, *_RIVALS)]
    tried = [_refit(setting, own, np.zeros(len(own)), tuned.change) for own in within]
    first, second = sorted([tuned, *tried], key=cost)[:2]
    sure = cost(second) - cost(first) > 2.0 * SURE_LEAD
    return _taking_part(setting, first) if sure and first.effects and type(first.effects[0]) in kinds else None


def _refit(setting: Setting, candidates: Sequence[Candidate], sizes: Array, change: Array) -> Fit:
    return refit(setting, candidates, sizes, change, steps=_STEPS, strong=True)


def _taking_part(setting: Setting, fit: Fit) -> Fit:
    """Return a fit without what is no larger in a mode than it is uncertain."""
    told = zip(fit.names, fit.values, fit.std, strict=True)
    spread = _SURE * float(np.sqrt(fit.misfit / fit.rows))
    sizes = ((i, value, std) for (i, name), value, std in told if name in fit.candidates[i].unit_sizes)
    large = {i for i, value, std in sizes if abs(value) > spread * std}
    keep = [i for i, c in enumerate(fit.candidates) if i in large or not is_mode(c.where)]
    return fit if len(keep) == len(fit.candidates) else _refit(setting, *fit.held(keep), fit.change)


def _swinging(setting: Setting) -> list[int]:
    """Return the modes whose frequency is within the band of the records."""
    linear, fast = setting.nominal, np.pi * setting.data.rate_hz
    swinging = (linear.sigma_1_s < linear.omega_rad_s) & (linear.omega_rad_s < fast)
    return [int(m) for m in np.flatnonzero(swinging)]


def _candidate(setting: Setting, kind: type[Effect], m: int) -> Candidate:
    views = [_view(setting.nominal, m, record.u, setting.data.rate_hz) for record in setting.data.records]
    loudest = max(views, key=lambda view: float(np.mean(view.position**2)))
    level = float(np.sqrt(np.mean(loudest.position**2)))
    shapes = {p.name: p.neutral for p in kind.parameters() if not p.size} | kind.guess(loudest)[0]
    # a force on a mode is measured by the deflection that it holds, so both have one unit
    units = {p.name: _PART * p.dimension.scale(level, level, 1.0) for p in kind.parameters() if p.size}
    return Candidate(kind, f"mode {m + 1}", shapes, units, shapes)


def _view(linear: ModalModel, m: int, u: Array, rate_hz: float) -> RecordView:
    """Return the excitation and the deflection of one mode when a record is played on the linear model."""
    deflection, rate = simulate(discretise(mode_alone(linear, m), rate_hz), u).T
    still = np.zeros(u.shape[0])
    return RecordView(rate_hz, still, deflection, rate, still, None, float(linear.omega_rad_s[m] / (2.0 * np.pi)))
