"""What several levels of excitation say: a linear response is the same at each, so a difference is not a linear law's.

The picture is that of the describing function: the linear model that answers best at each level (Gelb and Vander Velde,
Multiple-Input Describing Functions, 1968).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.nominal.tuning import nuisances_of
from analysis.diagnosis.response.fits import Setting, fit_nominal
from analysis.diagnosis.response.lines import Lines, noise_of
from analysis.diagnosis.result import Domain
from analysis.diagnosis.tails import chi2_tail, f_tail
from analysis.diagnosis.verdict.lack_of_fit import ONE_IN_A_MILLION
from sim_backend.effects.dominant import dominant_block
from sim_backend.linear import Array, ComplexArray, ModalModel
from sim_backend.model import Model

_FREE = 1.0
"""Relative trust in the nominal numbers while each level is described by itself."""

_SEEN = 3.0
"""Standard deviations by which a number has to change between levels to be spoken of."""


def compare_levels(setting: Setting, modelled: ComplexArray, model: Model, record: str) -> tuple[Domain, ...]:
    """Return how far the levels of each entry are apart; `modelled` (n,) is the response of the tuned nominal model.

    Nothing for entries of one level.
    """
    lines, found = setting.lines, []
    for o, i in sorted(set(zip(lines.output.tolist(), lines.input.tolist(), strict=True))):
        here = (lines.output == o) & (lines.input == i)
        if np.unique(lines.curve[here]).size > 1:
            found.append(_tested(setting, modelled, here, model.outputs[o].dof, record))
    return tuple(found)


def depends_on_level(levels: Sequence[Domain]) -> bool:
    """Tell whether noise alone would not make the levels differ so much."""
    return bool(levels) and min(d.p_value for d in levels) * len(levels) < ONE_IN_A_MILLION


def describe_levels(setting: Setting, model: Model) -> tuple[str, ...]:
    """Return in words how frequency, damping and static gain of the dominant mode change with the level, per entry."""
    lines = setting.lines
    remarks = []
    for o, i in sorted(set(zip(lines.output.tolist(), lines.input.tolist(), strict=True))):
        curves = np.unique(lines.curve[(lines.output == o) & (lines.input == i)])
        if curves.size > 1:
            each = [_of_level(setting, lines.only(lines.curve == number), o, i) for number in (curves[0], curves[-1])]
            where = f" of {model.inputs[i].dof} → {model.outputs[o].dof}" if len(model.outputs) > 1 else ""
            remarks.append(_words(each[0], each[1], where, lines.level_unit))
    return tuple(remarks)


def _tested(setting: Setting, modelled: ComplexArray, here: NDArray[np.bool_], name: str, record: str) -> Domain:
    """Return each level's deviation from the mean response in units of noise, relative to the model's, so it is smooth.

    A level with other points than the first is interpolated linearly between its own.
    """
    lines, sigma = setting.lines, setting.noise.sigma
    curves = [np.flatnonzero(here & (lines.curve == number)) for number in np.unique(lines.curve[here])]
    low = max(lines.frequency_hz[rows].min() for rows in curves)
    high = min(lines.frequency_hz[rows].max() for rows in curves)
    grid = lines.frequency_hz[curves[0]]
    grid = grid[(grid >= low) & (grid <= high)]
    level = np.array([lines.level[rows[0]] for rows in curves])
    if grid.size == 0:
        return Domain(record, name, level, lines.level_unit, np.zeros(level.size), np.ones(level.size), 1.0, "apart")
    values, weights = [], []
    for rows in curves:
        f, over = lines.frequency_hz[rows], lines.response[rows] / modelled[rows]
        deviation = sigma[rows] / np.abs(modelled[rows])[:, None]
        values.append(np.interp(grid, f, over.real) + 1j * np.interp(grid, f, over.imag))
        weights.append([1.0 / np.interp(grid, f, deviation[:, k]) ** 2 for k in (0, 1)])
    value, weight = np.array(values), np.array(weights)
    # along and across the phase: the model's is near the measured one
    parts = np.stack([value.real, value.imag], axis=1)
    mean = np.sum(weight * parts, axis=0) / np.sum(weight, axis=0)
    square = np.sum(weight * (parts - mean) ** 2, axis=(1, 2)) / (2 * grid.size)
    total, dof = float(np.sum(square)) * 2 * grid.size, 2 * grid.size * (len(curves) - 1)
    known = setting.noise.dof
    p = float(chi2_tail(total, dof) if np.isinf(known) else f_tail(total / dof, dof, known))
    size = np.sqrt(square * len(curves) / (len(curves) - 1))
    k = int(np.argmax(size))
    where = f"{name} at level {level[k]:g}, {size[k]:.3g} times the noise from the mean of all levels"
    return Domain(record, name, level, lines.level_unit, size, np.ones(size.size), p, where)


@dataclass(frozen=True)
class _Described:
    """The dominant mode at one level: frequency in Hz, damping ratio and static gain, with standard deviations."""

    level: float
    values: Array
    std: Array


def _of_level(setting: Setting, lines: Lines, o: int, i: int) -> _Described:
    linear = setting.linear
    nuisances = nuisances_of(linear, _FREE)
    alone = replace(setting, lines=lines, nuisances=nuisances)
    alone = replace(alone, noise=noise_of(lines, alone.modelled(linear, ())))
    found = fit_nominal(alone)
    m = dominant_block(linear, i, o)

    def numbers(model: ModalModel) -> Array:
        omega = float(model.omega_rad_s[m])
        if omega == 0.0:
            return np.array([np.nan, np.nan, np.nan])
        static = model.with_(delay_s=0.0 * model.delay_s).frequency_response(np.zeros(1))[0, o, i].real
        return np.array([omega / (2.0 * np.pi), model.sigma_1_s[m] / omega, static])

    values = numbers(found.linear)
    step = 1e-4
    moved = [(numbers(alone.tuned(found.white + step * unit)) - values) / step for unit in np.eye(found.white.size)]
    slope = np.array(moved).reshape(-1, 3)
    return _Described(
        float(lines.level[0]), values, np.sqrt(np.maximum(np.diag(slope.T @ found.covariance @ slope), 0))
    )


_WORDS = (
    (
        "the resonance",
        "Hz",
        "a spring that softens, or friction and hysteresis that hold at small levels",
        "a spring that hardens",
    ),
    ("its damping ratio", "", "dry friction", "hysteresis or drag that grows faster than the rate"),
    ("the static gain", "", "a drive that saturates", "friction or play at small levels"),
)
"""What is described, its unit, and what may be behind it falling and rising: physics, no effects of the library."""


def _words(first: _Described, last: _Described, where: str, unit: str) -> str:
    told, hints = [], []
    for k, (name, of, falling, rising) in enumerate(_WORDS):
        before, after = first.values[k], last.values[k]
        apart = float(np.hypot(first.std[k], last.std[k]))
        if not abs(after - before) > _SEEN * apart:
            continue
        change = 100.0 * (after - before) / before
        way, hint = ("rises", rising) if change > 0.0 else ("falls", falling)
        told.append(f"{name} {way} {abs(change):.2g} % (from {before:.5g} to {after:.5g}{f' {of}' if of else ''})")
        hints.append(hint)
    span = f"from {first.level:g} to {last.level:g} {unit if unit != '1' else ''}".rstrip()
    if not told:
        return f"{span}{where} the response changes otherwise than by frequency, damping or gain of the dominant mode"
    return f"{span}{where} {', '.join(told)}; to look at: {'; '.join(hints)} (a table alone does not show which)"
