"""Readings that are a sample old beneath noise of their own: samples that were lost before the noise was added.

No reading then repeats the last one. The loss shows by its size: at some samples, at random, the residual steps by just
the motion since the last reading that arrived, and at the others not at all. With z the residual's match to a single
sample, in units of the noise, and a(k) what a reading k samples old makes of it, z has the density

    (1 - p) sum over k of p^k f(z - a(k)),    a(0) = 0.

A delay would make all samples late by a fraction of a sample, clock jitter would scatter them about zero, and outliers
go in either direction: the evidence is that against the best of the three.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.tails import chi2_tail
from analysis.diagnosis.variance.chance import Chance
from analysis.diagnosis.variance.quantisation import lattices_of
from analysis.diagnosis.variance.repeats import MAD
from sim_backend.effects.base import Site
from sim_backend.effects.dropped_samples import DroppedSamples
from sim_backend.linear import Array

_OUTLIERS = tuple((part, wide) for part in (0.001, 0.01, 0.1) for wide in (3.0, 10.0))
"""Noise is normal but for a part that is so many times as wide, whichever of these fits the samples best (Tukey 1960):
no single sample may decide."""

_OLDEST = 4
"""Samples by which a reading may be late: of half of them lost, one in thirty-two is later."""

_MOST = 0.5
"""Beyond this share those that arrive are the exception."""

_DITHERED = 1.0
"""Normal noise of so many steps before a rounding leaves of what its error has to do with the motion a part of
exp(-2 π²), 3e-9 (Widrow and Kollár, Quantization Noise, 2008, chapter 5)."""

_ROUNDS = 3
"""Late samples make the noise look wider than it is, and the noise decides which samples are late."""


@dataclass(frozen=True)
class _Noise:
    """Noise of standard deviation `size`, but for a part `outliers` that is so many times as `wide`."""

    size: float
    outliers: float
    wide: float

    def log_density(self, z: Array) -> Array:
        """Return the logarithm of the density at `z`, up to a constant of all."""
        squares = -0.5 * (z / self.size) ** 2
        few = math.log(self.outliers / self.wide) + squares / self.wide**2
        return np.asarray(np.logaddexp(math.log1p(-self.outliers) + squares, few) - math.log(self.size))


@dataclass(frozen=True)
class _Rows:
    """What the residual's match is, `z` (n,), and what readings of 0, 1, 2 … samples before make of it, `a` (k, n)."""

    z: Array
    a: Array
    noise: _Noise

    @cached_property
    def by_age(self) -> Array:
        """How dense the noise is at every sample if its reading is so old, as a logarithm, (k, n)."""
        return self.noise.log_density(self.z - self.a)

    @cached_property
    def _densities(self) -> tuple[Array, float]:
        """The densities of `by_age` over the largest at each sample, and the sum of the logarithms of that.

        None that is too small to be a number counts: beside the largest stands at least a share's power of the age.
        """
        largest = np.max(self.by_age, axis=0)
        return np.exp(self.by_age - largest), float(np.sum(largest))

    @cached_property
    def on_time(self) -> float:
        """The log-likelihood of no loss."""
        return float(np.sum(self.noise.log_density(self.z)))

    def logs(self, share: float) -> Array:
        """Return the logarithm of the density of every sample by how old its reading is, (k, n)."""
        age = np.arange(self.a.shape[0])
        return self.by_age + (math.log1p(-share) + age * math.log(share))[:, None]

    def gained(self, share: float) -> float:
        """Return by how much the log-likelihood is above that of no loss."""
        densities, largest = self._densities
        total = np.zeros(self.z.size)
        for one in densities[::-1]:
            total = total * share + one
        return float(np.sum(np.log(total))) + self.z.size * math.log1p(-share) + largest - self.on_time

    def best(self) -> float:
        """Return the share of lost samples that is likeliest."""
        return float(scipy.optimize.minimize_scalar(lambda p: -self.gained(p), bounds=(1.0 / self.z.size, _MOST)).x)

    def std(self, share: float) -> float:
        """Return the standard deviation of that share, by the curvature of the log-likelihood there."""
        step = 0.1 * min(share, _MOST)
        near = [self.gained(share + k * step) for k in (-1, 0, 1)]
        return step / math.sqrt(max(2.0 * near[1] - near[0] - near[2], 1e-12))


def late_readings(setting: Setting, fit: Fit) -> list[Chance]:
    """Return every output of which some readings, at random, are those of a sample before."""
    # the error of steps follows the motion, unless noise that came before them hides it (a dither, `_DITHERED`)
    rounded = [c.where for c in fit.candidates if c.effect.whole and c.effect.site is Site.READING]
    innovations = {where: 1.0 / setting.whitener.taps[o, 0] for o, where in enumerate(setting.places.outputs)}
    lattices = lattices_of(setting.data, setting.places.outputs).items()
    in_steps = {*rounded, *(where for where, steps in lattices if innovations[where] < _DITHERED * steps.step)}
    found = (_late(setting, fit, o, w) for o, w in enumerate(setting.places.outputs) if w not in in_steps)
    return [one for one in found if one is not None]


def _late(setting: Setting, fit: Fit, output: int, where: str) -> Chance | None:
    matches = [_match(setting, fit, i, output) for i in range(len(setting.data.records))]
    z, a = (np.concatenate(parts, axis=-1) for parts in zip(*matches, strict=True))
    left = z
    for _ in range(_ROUNDS):
        size = MAD * float(np.median(np.abs(left))) if z.size else 0.0
        if size <= 0.0:
            return None
        noise = max((_Noise(size, *some) for some in _OUTLIERS), key=lambda n: float(np.sum(n.log_density(left))))
        rows = _Rows(z, a, noise)
        share = rows.best()
        likeliest = np.argmax(rows.logs(share), axis=0)
        left = z - np.take_along_axis(a, likeliest[None], axis=0)[0]
    gained = rows.gained(share)
    if gained <= 0.0:
        return None
    std, power = rows.std(share), share * float(np.sum((a[1] / noise.size) ** 2))
    return Chance(
        DroppedSamples(where, fraction=share),
        {"fraction": std},
        # of a share that may be any up to the most, the data leave so narrow a part; the others' one number likewise
        gained - max(math.log(_MOST / (math.sqrt(2.0 * math.pi) * std)), _best_other(rows, share)),
        0.5 * float(chi2_tail(2.0 * gained, 1)),
        power / setting.rows,
        math.sqrt(power),
    )


def _match(setting: Setting, fit: Fit, record: int, output: int) -> tuple[Array, Array]:
    """Return the match (n,) of the fitted samples' residual to a single sample, and that of old readings (k, n)."""
    run, residual = setting.data.records[record], fit.residuals[record][:, output]
    motion, taps, rows = run.y[:, output] - residual, setting.whitener.taps[output], run.fitted()
    size = float(np.linalg.norm(taps))
    white = setting.whitener.apply(residual[:, None], output)[:, 0]
    match = np.convolve(white, taps[::-1])[taps.size - 1 :] / size
    then = np.maximum(np.arange(run.n) - np.arange(_OLDEST + 1)[:, None], 0)
    return match[rows], size * (motion[then] - motion)[:, rows]


def _best_other(rows: _Rows, share: float) -> float:
    """Return the log-likelihood that a delay, jitter or outliers gain, each by one number of its own."""
    z, a, density = rows.z, rows.a[1], rows.noise.log_density
    part = float(np.clip(z @ a / max(float(a @ a), 1e-300), -1.0, 1.0))
    own, sides = density(z), np.logaddexp(density(z - a), density(z + a))

    def scattered(log_part: float) -> float:
        wide = np.sqrt(1.0 + (math.exp(log_part) * a / rows.noise.size) ** 2)
        return float(np.sum(density(z / wide) - np.log(wide) - own))

    def either(share: float) -> float:
        return float(np.sum(np.logaddexp(math.log1p(-share) + own, sides + math.log(0.5 * share)) - own))

    log_part = scipy.optimize.minimize_scalar(lambda p: -scattered(p), bounds=(-12.0, 0.0)).x
    late = float(np.sum(density(z - part * a) - own))
    return max(late, scattered(float(log_part)), either(share))
