"""Noise that grows with the angle: the size of what no model predicts, against where the axis stood.

The whitened residual is cut into short blocks and taken into the cosine basis. Only frequencies above a quarter of the
sample rate are used, because there is no motion up there and so no error of the model, while white noise is as strong
there as anywhere. The energy of a block is then a variance times a chi-square number, and that variance is compared
with position, command, rate, time and segment (score test of Breusch & Pagan 1979, studentised after Koenker 1981;
fit by maximum likelihood).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.noise.whitener import Bands, Whitener
from analysis.diagnosis.tails import normal_tail
from analysis.diagnosis.variance.chance import Chance
from campaigns.facts.base import stretches_of
from sim_backend.effects.apex_noise import ApexNoise
from sim_backend.linear import Array

BLOCK = 16
_UPPER = slice(BLOCK // 2, BLOCK)
_LOWER = slice(BLOCK // 8, BLOCK // 2)
"""Frequencies above a quarter of the sample rate, and those below it where the filtered noise is white."""

_LEAST_BLOCKS = 200
"""The score of fewer blocks is not normal enough far out in its tail."""

_WHITE = 0.5
"""What is white is as strong above as below; an error of the model that leaks upwards is much weaker there."""


@dataclass(frozen=True)
class Blocks:
    """Energies (n,) of the upper and lower half of the spectrum of every block, and means of what may explain them.

    `position` (n, 3) holds the mean second, third and fourth power of the position's magnitude, `others` by name (n,)
    what else the variance might grow with, `segment` (n,) numbers the windows. `gains` are the squared gains of the
    whitening filter, mean over either half.
    """

    upper: Array
    lower: Array
    position: Array
    others: dict[str, Array]
    segment: NDArray[np.int64]
    gains: tuple[float, float]


@dataclass(frozen=True)
class Law:
    """A law of the variance fitted to the blocks: parameters and their covariance, log-likelihood, variances (n,)."""

    values: Array
    covariance: Array
    log_likelihood: float
    variance: Array

    def evidence(self, n: int) -> float:
        """Return the logarithm of the evidence by the Bayesian information criterion, for `n` numbers."""
        return self.log_likelihood - 0.5 * self.values.size * math.log(n)


def uneven_noise(setting: Setting, fit: Fit) -> list[Chance]:
    """Return every output whose noise grows with its position, no worse than with anything else.

    Noise that differs between segments, or grows with the excitation, is not an effect: where it explains more there is
    nothing to name, however well the noise follows the position.
    """
    known = {e.where for e in setting.known if isinstance(e, ApexNoise)}
    found = []
    for o, where in enumerate(setting.places.outputs):
        blocks = blocks_of(setting, fit, o)
        if where in known or blocks is None:
            continue
        law, p_value, linear, quadratic = apex_law(blocks)
        if p_value > 0.5 or not _is_white(blocks, law):
            continue
        count = blocks.upper.size * (BLOCK // 2)
        evidence = law.evidence(count)
        rivals = {name: rival.evidence(count) for name, rival in _rivals(blocks).items()}
        if max(rivals.values()) > evidence:
            continue  # uneven it is, by something that no simulation gets wrong
        names = [name for name, there in (("linear", linear), ("quadratic", quadratic)) if there]
        values = dict(zip(names, law.values[1:], strict=True))
        std = dict(zip(names, np.sqrt(np.maximum(np.diag(law.covariance)[1:], 0.0)), strict=True))
        grown = law.variance / law.values[0] - 1.0
        power = float(np.mean(law.variance - law.values[0])) / blocks.gains[0]
        found.append(
            Chance(
                ApexNoise(where, **{k: float(v) for k, v in values.items()}),
                {k: float(v) for k, v in std.items()},
                evidence - rivals.pop(""),
                p_value,
                power * float(np.sum(setting.whitener.taps[o] ** 2)) / setting.data.n_outputs,
                math.sqrt(0.5 * (BLOCK // 2) * float(np.sum((grown - grown.mean()) ** 2))),
                tuple(sorted(((k, evidence - v) for k, v in rivals.items()), key=lambda pair: pair[1])),
                _louder(blocks, law, o, setting.data.n_outputs),
            )
        )
    return found


def _louder(blocks: Blocks, law: Law, output: int, n_outputs: int) -> Bands:
    """Return how much louder than on the average the noise is where the deflection is large.

    What acts there is seen in that noise: samples count by the fourth power of the position, as of a law of second
    order.
    """
    where = blocks.position[:, 2]
    levels = np.ones((n_outputs, 1))
    levels[output] = max(float(where @ law.variance) / float(where.sum()) / float(law.variance.mean()), 1.0)
    return Bands(np.array([0.0, 0.5]), levels)


def blocks_of(setting: Setting, fit: Fit, output: int) -> Blocks | None:
    """Return the blocks of all fitted samples of one output; None when there are too few."""
    upper, lower, powers, segment = [], [], [], []
    others: dict[str, list[Array]] = {}
    number, first = 0, 0.0
    for record, residual in zip(setting.data.records, fit.residuals, strict=True):
        white = setting.whitener.apply(residual[:, output, None], output)[:, 0]
        position = record.y - residual
        rate = np.gradient(position, axis=0)
        columns = {f"the command of {n}": record.u[:, j] ** 2 for j, n in enumerate(setting.places.inputs)}
        columns |= {f"the rate of {n}": rate[:, i] ** 2 for i, n in enumerate(setting.places.outputs)}
        columns |= {
            f"the position of {n}": position[:, i] ** 2 for i, n in enumerate(setting.places.outputs) if i != output
        }
        columns["time"] = first + np.arange(record.n, dtype=float)
        first += record.n
        for window in record.windows:
            number += 1
            mask = np.zeros(record.n, dtype=bool)
            mask[window.start : window.stop] = not window.held_out
            mask[: setting.whitener.order] = False
            for start, stop in stretches_of(mask):
                rows = slice(start, start + (stop - start) // BLOCK * BLOCK)
                energy = scipy.fft.dct(white[rows].reshape(-1, BLOCK), axis=1, norm="ortho") ** 2
                upper.append(energy[:, _UPPER].mean(axis=1))
                lower.append(energy[:, _LOWER].mean(axis=1))
                size = np.abs(position[rows, output])
                powers.append(np.stack([_means(size**k) for k in (2, 3, 4)], axis=1))
                segment.append(np.full(energy.shape[0], number))
                for name, values in columns.items():
                    others.setdefault(name, []).append(_means(values[rows]))
    if sum(e.size for e in upper) < _LEAST_BLOCKS:
        return None
    joined = {name: np.concatenate(parts) for name, parts in others.items()}
    gains = _gain(setting.whitener, output, _UPPER), _gain(setting.whitener, output, _LOWER)
    return Blocks(
        np.concatenate(upper), np.concatenate(lower), np.concatenate(powers), joined, np.concatenate(segment), gains
    )


def _means(values: Array) -> Array:
    return np.asarray(values.reshape(-1, BLOCK).mean(axis=1))


def _gain(whitener: Whitener, output: int, half: slice) -> float:
    frequency = (np.arange(BLOCK * 8) + 0.5) / (BLOCK * 16)
    line = np.exp(-2j * np.pi * np.outer(frequency, np.arange(whitener.order + 1)))
    power = np.abs(line @ whitener.taps[output]) ** 2
    return float(np.mean(power[half.start * 8 : half.stop * 8]))


def score_test(energy: Array, column: Array) -> float:
    """Return the one-sided p-value of `energy` (n,) growing with `column` (n,), whatever the energies' distribution."""
    x, e = column - column.mean(), energy - energy.mean()
    spread = math.sqrt(float(x @ x) * float(e @ e))
    return normal_tail(math.sqrt(x.size) * float(x @ e) / spread) if spread > 0.0 else 1.0


def apex_law(blocks: Blocks) -> tuple[Law, float, bool, bool]:
    """Return the best law of a standard deviation that grows with |position|, its p-value, and which terms it has."""
    p_value = min(2.0 * min(score_test(blocks.upper, blocks.position[:, k]) for k in (0, 2)), 1.0)
    count = blocks.upper.size * (BLOCK // 2)
    terms = [(True, False), (False, True), (True, True)]
    laws = [_apex(blocks, *which) for which in terms]
    best = max(range(len(laws)), key=lambda i: laws[i].evidence(count))
    return laws[best], p_value, *terms[best]


def _apex(blocks: Blocks, linear: bool, quadratic: bool) -> Law:
    """Return the law s² + g (a |x| + b x²)² of the variance, its parameters in physical units."""
    second, third, fourth = (blocks.gains[0] * blocks.position[:, k] for k in range(3))
    level = float(blocks.upper.mean())
    units = [math.sqrt(level / float(second.mean()))] * linear + [math.sqrt(level / float(fourth.mean()))] * quadratic

    def variance(x: Array) -> tuple[Array, Array]:
        a = x[1] * units[0] if linear else 0.0
        b = x[-1] * units[-1] if quadratic else 0.0
        slopes = [np.full(second.size, level)]
        slopes += [(2.0 * a * second + 2.0 * b * third) * units[0]] * linear
        slopes += [(2.0 * a * third + 2.0 * b * fourth) * units[-1]] * quadratic
        return x[0] * level + a * a * second + 2.0 * a * b * third + b * b * fourth, np.stack(slopes, axis=1)

    start = np.array([0.7, *([0.5 / math.sqrt(len(units))] * len(units))])
    return _fitted(blocks.upper, variance, start, np.array([level, *units]))


def _grown(energy: Array, column: Array) -> Law:
    """Return the law s² + c · column."""
    level = float(energy.mean())
    scaled = column / max(float(column.mean()), np.finfo(float).tiny) * level
    slopes = np.stack([np.full(energy.size, level), scaled], axis=1)
    return _fitted(energy, lambda x: (slopes @ x, slopes), np.array([0.8, 0.2]), np.array([level, 1.0]))


def _fitted(energy: Array, variance: Callable[[Array], tuple[Array, Array]], start: Array, units: Array) -> Law:
    """Return the law of largest likelihood, all parameters at least zero; `units` make them physical."""
    half = 0.25 * BLOCK  # half the degrees of freedom of a block's energy
    scale = half * energy.size

    def cost(x: Array) -> tuple[float, Array]:
        v, slopes = variance(x)
        loss = half * float(np.sum(np.log(v) + energy / v))
        return loss / scale, half * ((1.0 / v - energy / v**2) @ slopes) / scale

    bounds = [(1e-6, None)] + [(0.0, None)] * (start.size - 1)
    x = scipy.optimize.minimize(cost, start, jac=True, bounds=bounds, method="L-BFGS-B", options={"ftol": 1e-13}).x
    v, slopes = variance(x)
    relative = slopes / v[:, None]
    covariance = np.linalg.pinv(half * relative.T @ relative) * np.outer(units, units)
    return Law(x * units, covariance, -scale * cost(x)[0], v)


def _rivals(blocks: Blocks) -> dict[str, Law]:
    """Return what else the variance might follow, "" being nothing."""
    energy = blocks.upper
    mean = energy.mean()
    laws = {"": _levels(energy, np.full(energy.size, mean), 1)}
    names, at = np.unique(blocks.segment, return_inverse=True)
    means = np.bincount(at, weights=energy) / np.bincount(at)
    laws["noise that differs between segments"] = _levels(energy, means[at], names.size)
    for name, column in blocks.others.items():
        laws[f"noise that grows with {name}"] = _grown(energy, column)
    return laws


def _levels(energy: Array, variance: Array, count: int) -> Law:
    value = -0.25 * BLOCK * float(np.sum(np.log(variance) + energy / variance))
    return Law(np.zeros(count), np.zeros((count, count)), value, variance)


def _is_white(blocks: Blocks, law: Law) -> bool:
    """Tell whether the lower frequencies show no more than twice what the upper ones do, within the scatter."""
    shape = (law.variance - law.values[0]) / blocks.gains[0]
    x = shape - shape.mean()
    size = float(x @ x)
    if size <= 0.0:
        return False
    slopes, scatter = [], []
    for energy, gain in zip((blocks.upper, blocks.lower), blocks.gains, strict=True):
        slope = float(x @ energy) / size
        left = energy - energy.mean() - slope * x
        slopes.append(slope / gain)
        scatter.append(math.sqrt(float((x**2) @ left**2)) / size / gain)
    return slopes[0] > _WHITE * slopes[1] - 4.0 * math.hypot(scatter[0], _WHITE * scatter[1])
