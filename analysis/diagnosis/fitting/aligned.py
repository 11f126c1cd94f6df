"""Where the tuning of a nominal model begins: modes moved to where the data have them.

A descent moves a mode to its place only from within about its width. A light mode is narrower than its frequency is
known: five per cent of the frequency are fourteen widths of a mode of a damping ratio of 0.0035. From outside, what
the data show at the right place and the model at the wrong one have nothing to do with each other, and a search would
put a resonance here and take one away there. So such frequencies are first tried one by one over all that is plausible.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.fitting.fit import Setting, residuals_of, simulated
from analysis.diagnosis.nominal.responses import contrast, driven_by
from analysis.diagnosis.nominal.tuning import OWN_TOLERANCE, Knob, turned
from sim_backend.linear import DiscreteModel, ModalModel, discretise, finer_for_delays

Array = NDArray[np.float64]

_REACH = 3.0
"""Standard deviations of a frequency within which it is looked for: one in 400 lies outside."""

_SKIRT = 5.0
"""Half-widths of a resonance that are looked at beyond its outermost places."""

_MOST = 400
"""Places at which one mode is tried at most."""

_AROUND = 64
"""Parts of a spectrum over which the usual level of its lines is told."""

_PASSES = 3
"""How often all modes are gone through: of two that lie close, one is in the other's way at first."""


def aligned(setting: Setting) -> Array:
    """Return the change of the knobs (n_knobs,) that leaves least, of the frequencies of light modes alone.

    All other numbers are as they are. A line of a record's spectrum counts in units of what is usual around it: a weak
    mode is sought in the noise at its own frequency, whatever is strong elsewhere.
    """
    change = np.zeros(len(setting.knobs))
    knobs = [(i, k) for i, k in enumerate(setting.knobs) if _narrow(setting.nominal, k)]
    if not knobs:
        return change
    records = setting.data.records
    left = list(residuals_of(records, simulated(setting, setting.nominal, ())))
    for _ in range(_PASSES):
        before = change.copy()
        for i, knob in knobs:
            weights = [_weights(_spectrum(e[r.fitted()])) for e, r in zip(left, records, strict=True)]
            change[i], left = _moved(setting, change, i, knob, left, weights)
        if np.array_equal(before, change):
            break
    return change


def _spectrum(left: Array) -> Array:
    """Return the power of every line of residuals (n, n_y), (lines, n_y); a drift does not leak into all of them."""
    return np.asarray(np.abs(np.fft.rfft(left * np.hanning(left.shape[0])[:, None], axis=0)) ** 2)


def _weights(power: Array) -> Array:
    """Return one over the usual power around every line, of spectra (lines, n_y)."""
    width = max(power.shape[0] // _AROUND, 8)
    starts = range(0, power.shape[0], width)
    usual = np.stack([np.median(power[max(0, i - width) : i + 2 * width], axis=0) for i in starts])
    level = np.repeat(usual, width, axis=0)[: power.shape[0]]
    return np.asarray(np.divide(1.0, level, out=np.zeros_like(level), where=level > 0.0))


def _narrow(linear: ModalModel, knob: Knob) -> bool:
    """Tell whether a knob is a frequency that is known less well than the mode is wide."""
    return knob.field == "omega_rad_s" and knob.sd < OWN_TOLERANCE and _damping(linear, knob.mode) < knob.sd


def _damping(linear: ModalModel, m: int) -> float:
    return float(linear.sigma_1_s[m] / linear.omega_rad_s[m])


def _moved(
    setting: Setting, change: Array, i: int, knob: Knob, left: list[Array], weights: list[Array]
) -> tuple[float, list[Array]]:
    """Return the change of one frequency that leaves least, and what it leaves of every record, (n, n_y) each."""
    reach, split = _REACH * knob.sd, finer_for_delays(setting.nominal, setting.data.rate_hz) > 1
    count = int(np.clip(np.ceil(2.0 * reach / max(_damping(setting.nominal, knob.mode), 1e-9)), 8, _MOST))
    places = np.append(np.linspace(-reach, reach, count + 1), change[i])

    # beside its resonance a mode is a stiffness or a mass, and would make up for others that are wrong
    middle = float(setting.nominal.omega_rad_s[knob.mode]) / (2.0 * np.pi * setting.data.rate_hz)
    band = middle * np.exp(np.array([-1.0, 1.0]) * (reach + _SKIRT * _damping(setting.nominal, knob.mode)))

    def mode_at(place: float) -> DiscreteModel:
        there = change.copy()
        there[i] = place
        linear = turned(setting.nominal, setting.knobs, there)
        alone = linear.only(np.arange(linear.n_blocks) == knob.mode)
        model = discretise(alone.with_(d=np.zeros_like(alone.d)), setting.data.rate_hz, split=split)
        return replace(model, b=driven_by(model, setting.data.records[0].u[:0]).b)

    here, models = mode_at(change[i]), [mode_at(place) for place in places]
    whole = discretise(setting.nominal, setting.data.rate_hz, split=split)
    forces = [np.asfortranarray(driven_by(whole, r.u).forces) for r in setting.data.records]
    starts = [states[knob.mode] for states in setting.states]
    rows = [r.fitted() for r in setting.data.records]

    def left_by(model: DiscreteModel) -> list[Array]:
        return [e - contrast(model, here, f, x) for e, f, x in zip(left, forces, starts, strict=True)]

    def squares(model: DiscreteModel) -> float:
        total = 0.0
        for e, used, w in zip(left_by(model), rows, weights, strict=True):
            power = _spectrum(e[used]) * w
            lines = np.arange(power.shape[0]) / max(int(used.sum()), 1)
            total += float(np.sum(power[(lines > band[0]) & (lines < band[1])]))
        return total

    best = int(np.argmin([squares(model) for model in models]))
    return float(places[best]), left_by(models[best])
