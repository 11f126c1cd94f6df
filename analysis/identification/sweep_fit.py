"""The linear model of a stepped sine on one axis: its modes and, where the response shows them, a delay and lags."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.identification.determined import SIGNIFICANT, dropped_from
from analysis.identification.dropped import UNDETERMINED
from analysis.identification.identified import Fitted, deviations, fitted_by
from analysis.identification.missed_response import worst_miss
from analysis.identification.modal_parameters import Structure
from analysis.identification.rational import fit_rational
from analysis.identification.response_fit import RationalFit
from analysis.identification.static_gain import static_gain, static_gain_std
from analysis.recorded.sweep import Sweep
from sim_backend.linear import ModalModel

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

RELATIVE_START = 1e-3
"""Relative error of the first fit of a sweep: only its size against the noise matters, and only for that fit."""

CLEARER = 3.0
"""Times that a delay or a lag has to lower the relative misfit: hysteresis lags too, and is none of these."""

LAGS = 0.01
"""Relative misfit up to which modes alone are kept: hysteresis lags by so much, in the shape of a small delay."""

_PLAIN = Structure("mechanical", feedthrough=False)
_LAGGING = Structure("general", feedthrough=False)


@dataclass(frozen=True)
class _Try:
    """A fit, the structure it has, whole samples of delay that were taken off before, and its squared misfit."""

    fit: RationalFit
    whole: int
    relative2: float

    def model(self, rate_hz: float) -> ModalModel:
        """Return the model with all of its delay."""
        return self.fit.model.with_(delay_s=self.fit.model.delay_s + self.whole / rate_hz)


def fit_sweep(sweep: Sweep, rate_hz: float, orders: tuple[int, ...]) -> tuple[Fitted, tuple[str, ...]]:
    """Return the fit of one axis, and in words where it misses what was measured.

    Modes alone are fitted first. A delay, whole or not, and amplifier poles (modes that are no mechanical ones) are
    taken where they lower the relative misfit by CLEARER: a smooth misfit of a sine is known so well that anything
    with more freedom would win by a criterion.
    """
    usable = tuple(n for n in orders if 4 * n < sweep.frequency_hz.size) or orders[:1]
    best = _chosen(sweep, rate_hz, usable, _PLAIN, 0)
    noise2 = float(np.median(sweep.variance / np.abs(sweep.response) ** 2))
    if best.relative2 > max(CLEARER**2 * noise2, LAGS**2):
        forms = [best, *(_chosen(sweep, rate_hz, usable, *form) for form in _forms(sweep, rate_hz, usable))]
        least2 = max(min(one.relative2 for one in forms), noise2)
        near = [one for one in forms if one.relative2 <= CLEARER**2 * least2]
        # the first, which are the simplest, of those that are about as near as any
        best = next((one for one in near if _rests(one.fit)), near[0])
    model = best.model(rate_hz)
    modelled = model.frequency_response(sweep.frequency_hz, rate_hz)[:, 0, 0]
    fitted = fitted_by(best.fit, best.fit.chi2, best.fit.dof)
    return replace(fitted, linear=model), _told(sweep, modelled)


def _doubtful(fit: RationalFit) -> list[int]:
    """Return the modes to be given up, in turn: of unknown damping or size, or the slowest of unknown gain.

    The sizes of two modes that only cancel each other are not known, however well known both dampings are.
    """
    model, std, least = fit.model, deviations(fit), np.finfo(float).tiny
    size, by_rate = (
        np.abs(model.c[0]) / np.maximum(std.c[0], least),
        np.abs(model.c_rate[0]) / np.maximum(std.c_rate[0], least),
    )
    known = np.minimum(model.sigma_1_s / np.maximum(fit.sigma_std_1_s, least), np.maximum(size, by_rate))
    if np.any(known < SIGNIFICANT):
        return [int(i) for i in np.argsort(known) if known[i] < SIGNIFICANT]
    return [] if _rests(fit) else [int(np.argmin(np.min(np.abs(model.poles_1_s()), axis=1)))]


def _rests(fit: RationalFit) -> bool:
    """Tell whether the static gain of a fit is known; none is needed of a rigid body.

    Hysteresis lags as a real pole does that is slower than the slowest sine. Beside that pole any static gain fits.
    """
    gain, std = static_gain(fit.model), static_gain_std(fit)
    return gain is None or std is None or bool(np.all(np.abs(gain) >= SIGNIFICANT * std))


def _told(sweep: Sweep, modelled: ComplexArray) -> tuple[str, ...]:
    """Return the line at which the model misses most of the response, if that is much and not noise."""
    miss = worst_miss(sweep.frequency_hz, sweep.response, modelled, sweep.variance)
    if miss is None:
        return ()
    return (
        f"the model of {sweep.axis} misses {100.0 * miss.part:.3g} % of the response at {miss.frequency_hz:.4g} Hz, "
        "far more than its noise: give --modes, or sweep more closely there",
    )


def _forms(sweep: Sweep, rate_hz: float, orders: tuple[int, ...]) -> Iterator[tuple[Structure, int]]:
    """Yield what else may be fitted: delays of about what a smooth input would have, by themselves and with lags."""
    smooth = fit_rational(
        sweep.frequency_hz,
        sweep.response[:, None, None],
        orders[-1],
        variance=(sweep.variance + RELATIVE_START**2 * np.abs(sweep.response) ** 2)[:, None, None],
        structure=Structure("general", feedthrough=False, delay=True),
    )
    # a hold is late by half a sample by itself
    late = max(float(smooth.model.delay_s[0]) * rate_hz - 0.5, 0.0)
    wholes = sorted({int(np.floor(late)), int(np.ceil(late)), int(np.rint(late))} - {0})
    for structure in (_PLAIN, _LAGGING):
        if structure is _LAGGING:
            yield structure, 0
        for whole in wholes:
            yield structure, whole
        for whole in sorted({0, max(int(late) - 1, 0)}):
            yield Structure(structure.form, feedthrough=False, delay=True), whole


def _chosen(sweep: Sweep, rate_hz: float, orders: tuple[int, ...], structure: Structure, whole: int) -> _Try:
    """Fit one form; what no number of modes explains counts as a relative error beside the noise.

    The noise of sines is known to parts in 1e5; hysteresis and the end of the transient are larger, and weighted by the
    noise alone they would be taken for modes. So the largest order is fitted first with equal relative weights, and
    its relative misfit joins the noise in the weights of the choice. That misfit varies smoothly with frequency, which
    the criterion cannot know, so a mode whose damping is not significant is given up.
    """
    early = sweep.response * np.exp(2j * np.pi * sweep.frequency_hz / rate_hz * whole)
    magnitude2 = np.abs(early) ** 2

    def fitted(choice: tuple[int, ...], relative2: float, start: ModalModel | None = None) -> RationalFit:
        return fit_rational(
            sweep.frequency_hz,
            early[:, None, None],
            choice,
            variance=(sweep.variance + relative2 * magnitude2)[:, None, None],
            hold_rate_hz=rate_hz,
            structure=structure,
            start=start,
        )

    def missed2(fit: RationalFit) -> float:
        off = fit.model.frequency_response(sweep.frequency_hz, rate_hz)[:, 0, 0] - early
        # the median, because near a resonance the misfit is that of its frequency; of |error|², exponential, it is ln 2
        return float(np.median(np.abs(off) ** 2 / magnitude2) / np.log(2.0))

    relative2 = missed2(fitted(orders[-1:], RELATIVE_START**2))
    if structure != _PLAIN and len(orders) > 1:  # with more freedom a large order alone may end anywhere
        relative2 = min(relative2, missed2(fitted(orders, RELATIVE_START**2)))
    fit = fitted(orders, relative2)

    def without(one: RationalFit, doubtful: int) -> RationalFit | None:
        """Return the fit with a mode fewer; None where what is doubtful is needed."""
        rest = one.model.only(np.arange(one.model.n_blocks) != doubtful)
        # a new start may miss a mode that the larger fit had found
        fewer = min((fitted((rest.n_blocks,), relative2, start) for start in (None, rest)), key=lambda each: each.chi2)
        # one of two real poles may be far off although the block is real; a mode of no width is the error of a line
        real = one.model.sigma_1_s[doubtful] >= one.model.omega_rad_s[doubtful]
        if real and _rests(one) and missed2(fewer) > CLEARER**2 * missed2(one):
            return None
        return replace(fewer, dropped=(*one.dropped, dropped_from(one, doubtful, fewer, UNDETERMINED)))

    smaller: RationalFit | None = fit
    while smaller is not None:
        fit, some = smaller, _doubtful(smaller) if smaller.model.n_blocks > orders[0] else []
        smaller = next((less for one in some if (less := without(fit, one)) is not None), None)
    return _Try(fit, whole, missed2(fit))
