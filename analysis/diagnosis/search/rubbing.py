"""A drifting axis with friction: how large the friction is, from the balance of torques.

A free axis adds up every error of its torque. Beside the friction that the model lacks its residual is then drift, and
along the measured motion no friction explains that: at rest friction is equal to whatever torque it balances, which the
motion does not show. A balance of torques over the samples in which the axis moves determines its size all the same,
and a simulation that has it from the start stays near the record.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.search.extension import extended
from analysis.diagnosis.search.shortlist import Screen
from analysis.identification.axes import Moved, moved_by
from sim_backend.effects.coulomb_friction import CoulombFriction
from sim_backend.linear import Array

_PARTS = (1.0, 0.1, 0.01)
"""Parts of a screened breakaway rate or give at which a fit begins.

A balance of torques does not determine them, and a descent from ten times the truth passes a worse friction: one
that slips too late has a wrong size. A hundredth of the least screened shape is what the finest readings still
resolve.
"""


def rubbing(setting: Setting, fit: Fit, found: Screen) -> list[list[Fit]]:
    """Return `fit` with a friction of the size that the balance of torques gives, several fits for each variant.

    None where the balance gives none, at an axis that has its friction, and where the readings are not those of one
    drive each. The nuisances begin at the nominal model: absorbing a friction has moved them. The records begin as they
    are measured: a fit without the friction finds another rate there, which a friction would brake at once.
    """
    rubs = {c.where for c in fit.candidates if c.effect.reported() == CoulombFriction.name}
    if rubs >= set(setting.places.inputs):
        return []
    rows = [(r.u[r.fitted()], r.y[r.fitted()]) for r in setting.data.records]
    moved = moved_by([u for u, _ in rows], [y for _, y in rows], setting.data.rate_hz)
    if moved is None:
        return []
    of = dict(zip(setting.places.inputs, moved, strict=True))
    setting = replace(setting, states=_measured_starts(setting, moved, rubs))
    fits = []
    for i in found.best_per_key():
        candidate = found.candidates[i]
        if candidate.effect.reported() != CoulombFriction.name or candidate.where in rubs:
            continue
        balance = of[candidate.where].balance
        if balance is not None and balance.friction > 0.0:
            sizes = np.array([balance.friction / unit for unit in candidate.unit_sizes.values()])
            starts = [_sharper(candidate, part) for part in _PARTS]
            fits.append([extended(setting, fit, start, sizes, -fit.change) for start in starts])
    return fits


def _sharper(candidate: Candidate, part: float) -> Candidate:
    """Return the candidate with a part of those of its shapes that are measured along the motion."""
    along = {p.name for p in candidate.effect.parameters() if p.dimension.y}
    return replace(candidate, shapes={k: v * part if k in along else v for k, v in candidate.shapes.items()})


def _measured_starts(setting: Setting, moved: Sequence[Moved], rubs: Collection[str]) -> tuple[Array, ...]:
    """Return the states (m, 2) in which the records start: as measured for axes with friction, but for known `rubs`.

    They are those of the slowest mode that shows in the position of a reading, the axis itself. Other contributions to
    the reading, by its rate or direct, are left out: nothing distinguishes them.
    """
    nominal, states = setting.nominal, [some.copy() for some in setting.states]
    for place, axis in zip(setting.places.inputs, moved, strict=True):
        o = axis.readings[0]
        shares = np.abs(nominal.c[o])
        if axis.balance is None or axis.balance.friction == 0.0 or place in rubs or not shares.any():
            continue
        slowest = min(np.flatnonzero(shares), key=lambda m: (nominal.omega_rad_s[m], -shares[m]))
        for some, record in zip(states, setting.data.records, strict=True):
            measured = axis.balance.starts(record.y[:, o], setting.data.rate_hz)
            some[: nominal.n_blocks][shares > 0.0] = 0.0
            some[slowest] = np.array(measured) / nominal.c[o, slowest]
    return tuple(states)
