"""Modes at the frequencies that the data have, and numbered as the nominal model numbers them.

A descent moves a mode to its frequency only from within about its width. A lightly damped mode is narrower than its
frequency is known: five per cent of the frequency are fourteen widths of a mode of a damping ratio of 0.0035. From
outside, the peak in the data and the peak of the model do not overlap, and a search would add a resonance at one
frequency and cancel one at the other. So such frequencies are tried one by one over all that is plausible.

A model is the same whichever of its modes is called the first. Two modes that are closer together than their
frequencies are known may each be tuned to the other's frequency. The data fit as well, but every number then has the
prior of another mode, which biases every fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.nominal.responses import contrast, free_responses
from analysis.diagnosis.nominal.tuning import OWN_TOLERANCE, Nuisance, change_to, mahalanobis2_of, mode_alone, turned
from analysis.linear.simulate import driven_by
from sim_backend.linear import Array, DiscreteModel, ModalModel, played

_REACH = 3.0
"""Standard deviations of a frequency within which it is searched for: one in 400 lies outside."""

_SKIRT = 5.0
"""Half-widths of a resonance that are searched beyond its outermost frequencies."""

_MOST = 400
"""Frequencies at which one mode is tried at most."""

_AROUND = 64
"""Parts of a spectrum over each of which the usual level of its bins is estimated."""

_WORTH = 20.0
"""Squares, in units of the usual level around, by which a mode elsewhere must reduce the residual. Of hundreds of
frequencies, chance finds one a few times in a hundred; it costs a fit, which decides."""

_TRIED = 3
"""Frequencies of one mode that are fitted at most: where few bins show it, chance may make a wrong one the best."""

_TAPERED = 0.1
"""Part of a record that is tapered for its spectrum, half of it at either end."""

_SAME = 1e-9
"""Numbers that differ by less, relatively, are the same."""


def narrow_modes(setting: Setting) -> list[int]:
    """Return the modes whose frequency is known less well than they are wide, by number."""
    return [nuisance.mode for nuisance in setting.nuisances if _narrow(setting.nominal, nuisance)]


def is_bent(setting: Setting, change: Array) -> bool:
    """Tell whether a `change` (n_nuisances,) moves any number of a light mode farther than it may be off."""
    return _distorted(setting, change, narrow_modes(setting))


def _distorted(setting: Setting, change: Array, modes: Sequence[int]) -> bool:
    own = (pair for pair in zip(change, setting.nuisances, strict=True) if pair[1].mode in modes)
    return any(abs(moved) > _REACH * nuisance.sd for moved, nuisance in own)


def moved_mode(setting: Setting, fit: Fit, m: int) -> list[Array]:
    """Return the changes (n_nuisances,) of a fit with mode `m` where the residual is least; none if it is undistorted.

    The mode's own numbers are the nominal ones again but for its frequency, as a mode at the wrong frequency is
    distorted; all others are unchanged. One that is distorted beyond its tolerance may have come to the right
    frequency, and kept the distortion from the path there. A bin of a record's spectrum counts in units of the usual
    level around it: a weak mode is searched for in the noise at its own frequency, whatever is strong elsewhere.
    """
    weights = [_weights(_spectrum(e[r.fitted()])) for e, r in zip(fit.residuals, setting.data.records, strict=True)]
    numbers = np.array([nuisance.mode for nuisance in setting.nuisances])
    (i,) = (k for k, nuisance in enumerate(setting.nuisances) if nuisance.mode == m and nuisance.field == "omega_rad_s")
    change = np.where(numbers == m, 0.0, fit.change)
    places = _places(setting, fit, i, change, weights)
    if not places and _distorted(setting, fit.change, [m]):
        places = [float(fit.change[i])]
    return [np.where(np.arange(change.size) == i, place, change) for place in places]


def _spectrum(left: Array) -> Array:
    """Return the power in every frequency bin of residuals (n, n_y), (bins, n_y)."""
    return np.asarray(np.abs(_lines(left)) ** 2)


def _lines(left: Array) -> NDArray[np.complex128]:
    """Return the spectrum of `left` (n, …) along its first axis; a drift does not leak into all bins.

    Only the ends are tapered: a sweep may pass a mode in the last twentieth of a record.
    """
    taper = scipy.signal.windows.tukey(left.shape[0], _TAPERED).reshape(-1, *[1] * (left.ndim - 1))
    return np.asarray(np.fft.rfft(left * taper, axis=0))


def _beside(left: NDArray[np.complex128], swing: NDArray[np.complex128]) -> float:
    """Return the squares of bins `left` (k, n_y) without the best fit of a start's free response `swing` (k, n_y, 2).

    A light mode still rings from before a record: at the wrong frequency no start explains that.
    """
    target = np.concatenate([left.real.ravel(), left.imag.ravel()])
    columns = np.concatenate([swing.real.reshape(-1, 2), swing.imag.reshape(-1, 2)])
    size = np.linalg.norm(columns, axis=0)
    if target.size <= 2 or not np.all(size > 0.0):
        return float(target @ target)
    # what there is of a start is nearly as much a sine as a cosine, so that no more care is needed
    basis = np.linalg.qr(columns / size)[0]
    return float(target @ target - np.sum((basis.T @ target) ** 2))


def _weights(power: Array) -> Array:
    """Return one over the usual power around every bin, of spectra (bins, n_y)."""
    width = max(power.shape[0] // _AROUND, 8)
    starts = range(0, power.shape[0], width)
    usual = np.stack([np.median(power[max(0, i - width) : i + 2 * width], axis=0) for i in starts])
    level = np.repeat(usual, width, axis=0)[: power.shape[0]]
    return np.asarray(np.divide(1.0, level, out=np.zeros_like(level), where=level > 0.0))


def _narrow(linear: ModalModel, nuisance: Nuisance) -> bool:
    """Tell whether a nuisance is a frequency that is known less well than the mode is wide."""
    return (
        nuisance.field == "omega_rad_s"
        and nuisance.sd < OWN_TOLERANCE
        and _damping(linear, nuisance.mode) < nuisance.sd
    )


def _damping(linear: ModalModel, m: int) -> float:
    return float(linear.sigma_1_s[m] / linear.omega_rad_s[m])


def _places(setting: Setting, fit: Fit, i: int, change: Array, weights: list[Array]) -> list[float]:
    """Return the changes of the frequency of nuisance `i` beside `change` that leave the least residual, best first.

    None where the mode is right. A frequency within half a width of the mode is that of the mode, and one beside the
    skirt of a better one is part of it. The prior counts as it does in a fit.
    """
    nuisance = setting.nuisances[i]
    reach, whole = _REACH * nuisance.sd, played(setting.nominal, setting.data.rate_hz)
    width = max(_damping(setting.nominal, nuisance.mode), 1e-9)
    places = np.linspace(-reach, reach, int(np.clip(np.ceil(2.0 * reach / width), 8, _MOST)) + 1)
    # beside its resonance a mode is a stiffness or a mass, and would make up for others that are wrong
    middle = float(setting.nominal.omega_rad_s[nuisance.mode]) / (2.0 * np.pi * setting.data.rate_hz)
    band = middle * np.exp(np.array([-1.0, 1.0]) * (reach + _SKIRT * width))

    def mode_of(values: Array) -> DiscreteModel:
        linear = turned(setting.nominal, setting.nuisances, values)
        return mode_alone(linear, nuisance.mode, setting.data.rate_hz, split=whole.late is not None)

    def at(place: float) -> DiscreteModel:
        there = change.copy()
        there[i] = place
        return mode_of(there)

    now = mode_of(fit.change)
    forces = [np.asfortranarray(driven_by(whole, r.u).forces) for r in setting.data.records]
    starts = [states[nuisance.mode] for states in fit.states]
    rows = [r.fitted() for r in setting.data.records]

    def squares(model: DiscreteModel) -> float:
        total = 0.0
        for e, f, x, used, w in zip(fit.residuals, forces, starts, rows, weights, strict=True):
            lines = np.arange(w.shape[0]) / max(int(used.sum()), 1)
            near, loud = (lines > band[0]) & (lines < band[1]), np.sqrt(w)
            left, swing = e - contrast(model, now, f, x), free_responses(model, e.shape[0])
            total += _beside(*((_lines(part[used]).T * loud.T).T[near] for part in (left, swing)))
        return total

    def unlikely(place: float | Array) -> float | Array:
        """Return the squared distance in deviations, in units of the squares of bins.

        The squares of bins of noise, in units of their median, count ln 2 in the logarithm of the likelihood.
        """
        return 0.5 / np.log(2.0) * (place / nuisance.sd) ** 2

    left = np.array([squares(at(place)) for place in places]) + unlikely(places)
    enough = squares(now) + unlikely(fit.change[i]) - _WORTH
    # a resonance appears as wide as it is, or as the frequency resolution of a record of that length
    apart = _SKIRT * max(width, min(1.0 / (middle * max(int(used.sum()), 1)) for used in rows))
    found: list[float] = []
    for k in np.argsort(left):
        here = abs(places[k] - fit.change[i]) < 0.5 * width
        if left[k] > enough or len(found) == _TRIED or (here and not found):
            break
        if not here and all(abs(places[k] - other) > apart for other in found):
            found.append(float(places[k]))
    return found


def numbered(nominal: ModalModel, nuisances: Sequence[Nuisance], change: Array) -> Array:
    """Return the change of the nuisances (n_nuisances,) that makes the model which `change` makes and is the likeliest.

    Pairs of modes are exchanged one after the other, as long as that brings all numbers nearer to the nominal ones.
    """
    best = mahalanobis2_of(nuisances, change)
    pairs = list(combinations(range(nominal.n_blocks), 2))
    while others := [
        other for pair in pairs if (other := _exchanged(nominal, list(nuisances), change, pair)) is not None
    ]:
        distances2 = [mahalanobis2_of(nuisances, other) for other in others]
        if not min(distances2) < best:
            break
        best, change = min(distances2), others[int(np.argmin(distances2))]
    return change


def _exchanged(nominal: ModalModel, nuisances: list[Nuisance], change: Array, pair: tuple[int, int]) -> Array | None:
    """Return the change that gives each of two modes the other's numbers; None where no nuisances can."""
    model = turned(nominal, nuisances, change)
    order = np.arange(nominal.n_blocks)
    order[list(pair)] = pair[::-1]
    # a mode is what it is whichever of its participations is held
    held = _held(nominal, nuisances)
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
    found = change_to(nominal, nuisances, wanted)
    made = vars(turned(nominal, nuisances, found))
    same = all(np.allclose(value, made[name], rtol=_SAME, atol=0.0) for name, value in vars(wanted).items())
    return found if same else None


def _held(nominal: ModalModel, nuisances: Sequence[Nuisance]) -> NDArray[np.intp]:
    """Return which participation of every mode no nuisance adjusts (m,): its row in the outputs' above the rates'."""
    n_y = nominal.n_outputs
    free = np.vstack([nominal.c, nominal.c_rate]) != 0.0
    for nuisance in nuisances:
        if nuisance.field in ("c", "c_rate"):
            free[nuisance.index[0] + n_y * (nuisance.field == "c_rate"), nuisance.index[1]] = False
    return np.argmax(free, axis=0)
