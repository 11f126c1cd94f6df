"""The nominal model's own parameters: which may be re-tuned, how far each is trusted, what its change looks like.

Each mode has a logarithmic frequency, a logarithmic decay rate, and logarithms of its participations (those that are
not zero; the largest output participation of each mode is fixed, because only products matter). Their prior is a normal
distribution of the tolerance the nominal model claims, so a wrong gain of one per cent is never taken for physics,
and a shift far beyond the tolerance stays visible as one.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.nominal.responses import coasting, simulate
from sim_backend.linear import ModalModel, discretise

Array = NDArray[np.float64]

_STEP = 1e-5
"""Relative step of finite differences: the square root of rounding at the size of a response, in double precision."""


@dataclass(frozen=True)
class Knob:
    """One re-tunable parameter: `field` of the ModalModel at `index`, on a logarithmic scale, with its prior sd."""

    field: str
    index: tuple[int, ...]
    mode: int
    sd: float


REACH = 3.0
"""Knobs stay within a factor of twenty, e^3. A prior alone does not hold them against a gross error of the model."""

OWN_TOLERANCE = 1.0
"""Relative trust in a model that was fitted to the very runs that are diagnosed: whatever they show, its numbers had
to follow, so they say nothing on their own."""


def knobs_of(linear: ModalModel, tolerance: float) -> list[Knob]:
    """Return every re-tunable parameter of `linear`, each trusted to the relative `tolerance`."""
    knobs: list[Knob] = []
    for m in range(linear.n_blocks):
        for name in ("omega_rad_s", "sigma_1_s"):
            if getattr(linear, name)[m] > 0.0:
                knobs.append(Knob(name, (m,), m, tolerance))
        shares = [("c", i) for i in range(linear.n_outputs)] + [("c_rate", i) for i in range(linear.n_outputs)]
        present = [(name, i) for name, i in shares if getattr(linear, name)[i, m] != 0.0]
        if present:
            # participation in displacement and rate differ in unit; compare them at the mode's own frequency
            present.remove(max(present, key=lambda s: abs(getattr(linear, s[0])[s[1], m]) * _unit(linear, s[0], m)))
        knobs += [Knob(name, (i, m), m, tolerance) for name, i in present]
        knobs += [
            Knob(name, (m, j), m, tolerance)
            for name in ("b", "b_direct")
            for j in range(linear.n_inputs)
            if getattr(linear, name)[m, j] != 0.0
        ]
    return knobs


def _unit(linear: ModalModel, name: str, m: int) -> float:
    return float(linear.omega_rad_s[m]) if name == "c_rate" else 1.0


def turned(linear: ModalModel, knobs: list[Knob], change: Array) -> ModalModel:
    """Return `linear` with every knob's parameter multiplied by exp(change)."""
    moved: dict[str, Array] = {}
    for knob, delta in zip(knobs, change, strict=True):
        values = moved.setdefault(knob.field, getattr(linear, knob.field).copy())
        values[knob.index] *= np.exp(delta)
    return linear.with_(**moved)


def deviations(linear: ModalModel, knobs: list[Knob], change_std: Array) -> ModalModel:
    """Return the standard deviations of the parameters of `linear`, in its shapes; zero for what no knob turns.

    `change_std` (n_knobs,) are those of the knobs, which are logarithms.
    """
    spread = {f.name: np.zeros_like(getattr(linear, f.name)) for f in fields(linear)}
    for knob, std in zip(knobs, change_std, strict=True):
        spread[knob.field][knob.index] = abs(getattr(linear, knob.field)[knob.index]) * std
    return linear.with_(**spread)


def imitation(linear: ModalModel, knobs: list[Knob], changed: ModalModel) -> Array:
    """Return the change (n_knobs,) of the knobs of `linear` that makes its parameters those of `changed`.

    Modes that `changed` has beyond those of `linear` are left alone.
    """
    out = np.zeros(len(knobs))
    for i, knob in enumerate(knobs):
        before, after = getattr(linear, knob.field)[knob.index], getattr(changed, knob.field)[knob.index]
        out[i] = np.log(after / before) if after / before > 0.0 else 0.0
    return out


def sensitivities(
    linear: ModalModel, knobs: list[Knob], u: Array, rate_hz: float, start: Array, *, through_delay: bool = True
) -> Array:
    """Return the change of the outputs per unit of each knob, shape (n, n_y, n_knobs), by central differences.

    `u` (n, n_u) are commands or, without `through_delay`, torques, `start` (m, 2) the states in which they find the
    model. Only the knob's own mode is simulated, so that the cost is that of two modes per knob.
    """

    def moved(knob: Knob, by: float) -> Array:
        mode = discretise(_only(turned(linear, [knob], np.array([by])), knob.mode), rate_hz)
        begins = start[knob.mode : knob.mode + 1]
        return simulate(mode, u, through_delay=through_delay) + coasting(mode, begins, u.shape[0])

    out = np.empty((u.shape[0], linear.n_outputs, len(knobs)))
    for k, knob in enumerate(knobs):
        out[:, :, k] = (moved(knob, _STEP) - moved(knob, -_STEP)) / (2.0 * _STEP)
    return out


def _only(linear: ModalModel, m: int) -> ModalModel:
    """Return the model with mode `m` alone and no direct term."""
    pick = slice(m, m + 1)
    return linear.with_(
        omega_rad_s=linear.omega_rad_s[pick],
        sigma_1_s=linear.sigma_1_s[pick],
        b=linear.b[pick],
        b_direct=linear.b_direct[pick],
        c=linear.c[:, pick],
        c_rate=linear.c_rate[:, pick],
        d=np.zeros_like(linear.d),
    )
