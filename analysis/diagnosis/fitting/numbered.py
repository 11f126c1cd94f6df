"""Modes numbered as the nominal model numbers them, where a descent has exchanged two.

A model is the same whichever of its modes is called the first. Two that lie closer together than their frequencies are
known may each be tuned to the other's place: the data fit as well, but every number is then held to what is known of
another mode, and no fit is free of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.nominal.prior import strain_of
from analysis.diagnosis.nominal.tuning import Knob, imitation, turned
from sim_backend.linear import ModalModel

Array = NDArray[np.float64]

_SAME = 1e-9
"""Numbers that differ by less, relatively, are the same."""


def numbered(nominal: ModalModel, knobs: Sequence[Knob], change: Array) -> Array:
    """Return the change of the knobs (n_knobs,) that makes the model which `change` makes and is the likeliest.

    Pairs of modes are exchanged one after the other, as long as that brings all numbers nearer to the nominal ones.
    """
    best = strain_of(knobs, change)
    pairs = list(combinations(range(nominal.n_blocks), 2))
    while others := [other for pair in pairs if (other := _exchanged(nominal, list(knobs), change, pair)) is not None]:
        strains = [strain_of(knobs, other) for other in others]
        if not min(strains) < best:
            break
        best, change = min(strains), others[int(np.argmin(strains))]
    return change


def _exchanged(nominal: ModalModel, knobs: list[Knob], change: Array, pair: tuple[int, int]) -> Array | None:
    """Return the change that gives each of two modes the other's numbers; None where no knobs can."""
    model = turned(nominal, knobs, change)
    order = np.arange(nominal.n_blocks)
    order[list(pair)] = pair[::-1]
    # a mode is what it is whichever of its participations is held
    held = _held(nominal, knobs)
    shown = np.vstack([model.c, model.c_rate])
    here, there = shown[held, np.arange(order.size)], shown[held, order]
    if not np.all(here * there):
        return None
    part = here / there
    wanted = model.with_(
        omega_rad_s=model.omega_rad_s[order],
        sigma_1_s=model.sigma_1_s[order],
        b=model.b[order] / part[:, None],
        b_direct=model.b_direct[order] / part[:, None],
        c=model.c[:, order] * part,
        c_rate=model.c_rate[:, order] * part,
    )
    found = imitation(nominal, knobs, wanted)
    made = vars(turned(nominal, knobs, found))
    same = all(np.allclose(value, made[name], rtol=_SAME, atol=0.0) for name, value in vars(wanted).items())
    return found if same else None


def _held(nominal: ModalModel, knobs: Sequence[Knob]) -> NDArray[np.intp]:
    """Return which participation of every mode no knob turns (m,): its row in the outputs' above the rates'."""
    n_y = nominal.n_outputs
    free = np.vstack([nominal.c, nominal.c_rate]) != 0.0
    for knob in knobs:
        if knob.field in ("c", "c_rate"):
            free[knob.index[0] + n_y * (knob.field == "c_rate"), knob.index[1]] = False
    return np.argmax(free, axis=0)
