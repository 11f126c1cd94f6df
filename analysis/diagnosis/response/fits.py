"""Fits of hypotheses to a response: tuned numbers of the nominal model and parameters of effects, with their evidence.

A hypothesis has its tuned numbers in units of what the nominal model's tolerance allows (white, unit normal) and its
effects' parameters on scales of order one with their priors. The level s² of the noise is known from ν numbers only, so
that it is integrated out: the likelihood of n numbers with the sum of squares χ² goes with (1 + χ²/ν)^-(ν + n)/2. The
evidence is that of Laplace's approximation about the most probable point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.candidates.parameters import Scale, parameters_of
from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.nominal.tuning import Nuisance, bounds_of, factor_of, turned
from analysis.diagnosis.response.lines import Lines, Noise
from analysis.linear.predicted import Predictor
from sim_backend.effects.base import Effect
from sim_backend.errors import ConfigError
from sim_backend.linear import Array, ComplexArray, ModalModel

_STEP = 1e-6
_ITERATIONS = 60
_CLOSE = 1e-4
"""Fall of the sum of squares, in noises, that ends a descent: a ten-thousandth of what the data can tell."""
_ROUNDS = 20
"""Times at most that the level of the noise and the fit follow each other, until they agree to `_AGREED`."""

_AGREED = 0.01

_COARSE = 0.05
"""Relative error beside the noise of the first descent, which only has to come near."""


@dataclass(frozen=True)
class Setting:
    """What all hypotheses share: the points that are fitted, their noise, the model, its effects and nuisances."""

    lines: Lines
    noise: Noise
    linear: ModalModel
    known: tuple[Effect, ...]
    nuisances: list[Nuisance]
    predictor: Predictor

    @cached_property
    def turn(self) -> Array:
        """Factor (n_nuisances, n_nuisances) that makes changes of the nuisances of unit normal numbers."""
        return factor_of(self.nuisances) if self.nuisances else np.zeros((0, 0))

    @cached_property
    def _whitening(self) -> tuple[ComplexArray, Array]:
        return np.exp(-1j * np.angle(self.lines.response)), 1.0 / self.noise.sigma

    def tuned(self, white: Array) -> ModalModel:
        """Return the linear model with nuisances from independent unit normals `white` (n_nuisances,), clipped."""
        low, high = bounds_of(self.nuisances) if self.nuisances else (np.zeros(0), np.zeros(0))
        return turned(self.linear, self.nuisances, np.clip(self.turn @ white, low, high))

    def modelled(self, linear: ModalModel, effects: Sequence[Effect]) -> ComplexArray:
        """Return the response at every point (n,)."""
        predictor, back = self._at_lines
        whole = predictor.response(linear, (*self.known, *effects))
        return whole[back, self.lines.output, self.lines.input]

    def whitened(self, response: ComplexArray) -> Array:
        """Return what a response (n,) leaves of the measured one, along and across it, in noises, shape (2 n,)."""
        turn, per = self._whitening
        left = (self.lines.response - response) * turn
        return np.concatenate([left.real * per[:, 0], left.imag * per[:, 1]])

    def apart(self, response: ComplexArray) -> Array:
        """Return the logarithm of a response (n,) over the measured one, shape (2 n,), over a coarse error and noise.

        From a peak that is off by many of its widths the sum of squares of `whitened` has a slope to nowhere; the
        logarithm has one to the peak.
        """
        size = np.abs(self.lines.response)
        ratio = response / self.lines.response
        tiny = np.finfo(float).tiny
        per = 1.0 / np.hypot(_COARSE, self.noise.sigma / size[:, None])
        return np.concatenate([np.log(np.abs(ratio) + tiny) * per[:, 0], np.angle(ratio) * per[:, 1]])

    @cached_property
    def _at_lines(self) -> tuple[Predictor, NDArray[np.int64]]:
        """Predictor at each distinct frequency, and which of these each point has."""
        f, back = np.unique(self.lines.frequency_hz, return_inverse=True)
        return replace(self.predictor, frequency_hz=f), back.reshape(-1)


@dataclass(frozen=True)
class Fit:
    """One fitted hypothesis: nuisances `white` (n_nuisances,) and effects, with the evidence as a natural logarithm.

    `chi2` is the sum of squares in noises; `names`, `values` and `std` are those of the effects' parameters, by number
    of the effect; `covariance` is that of the nuisances and the parameters on their scales.
    """

    candidates: tuple[Candidate, ...]
    effects: tuple[Effect, ...]
    white: Array
    linear: ModalModel
    names: tuple[tuple[int, str], ...]
    values: Array
    std: Array
    covariance: Array
    sizes: Array
    chi2: float
    evidence: float


def log_likelihood(chi2: float, n: int, dof: float) -> float:
    """Return the logarithm of the likelihood of `n` numbers, up to a constant, for any level of the noise."""
    if np.isinf(dof):
        return -0.5 * chi2
    return float(-0.5 * (dof + n) * np.log1p(chi2 / dof))


def fit(
    setting: Setting,
    candidates: Sequence[Candidate] = (),
    sizes: Array | None = None,
    white: Array | None = None,
) -> Fit | None:
    """Return the hypothesis of `candidates`, `sizes` their first sizes in natural units; None where none can be.

    `white` (n_nuisances,) is where the nuisances begin, by default at the nominal model.
    """
    scales, start = parameters_of(candidates, np.zeros(0) if sizes is None else sizes)
    n_nuisances, n = len(setting.nuisances), 2 * setting.lines.n
    mean = np.concatenate([np.zeros(n_nuisances), [s.mean for s in scales]])
    sd = np.concatenate([np.ones(n_nuisances), [s.sd for s in scales]])
    low = np.concatenate([np.full(n_nuisances, -np.inf), [s.bound(s.low) for s in scales]])
    high = np.concatenate([np.full(n_nuisances, np.inf), [s.bound(s.high) for s in scales]])
    widest = np.concatenate([np.full(n_nuisances, 5.0), [s.step() for s in scales]])

    def modelled(x: Array) -> ComplexArray:
        return setting.modelled(setting.tuned(x[:n_nuisances]), _made(candidates, scales, x[n_nuisances:]))

    def left(x: Array) -> Array:
        return setting.whitened(modelled(x))

    x = np.clip(np.concatenate([np.zeros(n_nuisances) if white is None else white, start]), low, high)
    try:
        left(x)
    except ConfigError:
        return None

    def coarse(x: Array) -> Array:
        return np.concatenate([setting.apart(modelled(x)), (x - mean) / sd])

    x, _ = descend(coarse, x, low, high, widest)
    level2 = 1.0  # from noise that is too low: where the data are held for little, the prior keeps the nuisances
    for _ in range(_ROUNDS):

        def whole(x: Array, scale: float = level2**-0.5) -> Array:
            return np.concatenate([left(x) * scale, (x - mean) / sd])

        x, jacobian = descend(whole, x, low, high, widest)
        data = left(x)
        before, level2 = level2, _level2(float(data @ data), n, setting.noise.dof)
        if abs(level2 - before) <= _AGREED * before:
            break
    effects = _made(candidates, scales, x[n_nuisances:])
    prior = float(np.sum(((x - mean) / sd) ** 2)) + 2.0 * float(np.sum(np.log(sd)))
    return _fit_at(setting, candidates, effects, scales, x[:n_nuisances], jacobian, float(data @ data), prior)


def fit_nominal(setting: Setting, white: Array | None = None) -> Fit:
    """Return the nominal model tuned, its nuisances begun at `white` (n_nuisances,)."""
    found = fit(setting, white=white)
    assert found is not None  # without effects there is nothing that a model cannot hold
    return found


def _fit_at(
    setting: Setting,
    candidates: Sequence[Candidate],
    effects: tuple[Effect, ...],
    scales: Sequence[Scale],
    white: Array,
    jacobian: Array,
    chi2: float,
    prior: float,
) -> Fit:
    """Return a fit from where its descent has ended; `prior` is minus twice the logarithm of the prior there."""
    information = jacobian.T @ jacobian
    _, volume = np.linalg.slogdet(information)
    evidence = log_likelihood(chi2, 2 * setting.lines.n, setting.noise.dof) - 0.5 * (prior + volume)
    covariance = np.linalg.pinv(information, hermitian=True)
    spread = np.sqrt(np.maximum(np.diag(covariance)[white.size :], 0.0))
    values = np.array([float(getattr(effects[s.effect], s.name)) for s in scales])
    per = np.array([value if s.log else s.unit for s, value in zip(scales, values, strict=True)])
    return Fit(
        candidates=tuple(
            replace(c, shapes={k: float(getattr(e, k)) for k in c.shapes})
            for c, e in zip(candidates, effects, strict=True)
        ),
        effects=effects,
        white=white,
        linear=setting.tuned(white),
        names=tuple((s.effect, s.name) for s in scales),
        values=values,
        std=np.abs(per) * spread,
        covariance=np.asarray(covariance, dtype=float),
        sizes=_sizes(candidates, effects),
        chi2=chi2,
        evidence=float(evidence),
    )


def _level2(chi2: float, n: int, dof: float) -> float:
    """Return the most probable square of the level of the noise."""
    return 1.0 if np.isinf(dof) else (dof + chi2) / (dof + n)


def _made(candidates: Sequence[Candidate], scales: Sequence[Scale], x: Array) -> tuple[Effect, ...]:
    values: list[dict[str, float]] = [{} for _ in candidates]
    for scale, at in zip(scales, x, strict=True):
        values[scale.effect][scale.name] = scale.back(float(at))
    return tuple(c.made(v) for c, v in zip(candidates, values, strict=True))


def _sizes(candidates: Sequence[Candidate], effects: Sequence[Effect]) -> Array:
    """Return the sizes in natural units, one per size of each effect and one for an effect that has none."""
    out: list[float] = []
    for c, e in zip(candidates, effects, strict=True):
        out += [float(getattr(e, name)) / unit for name, unit in c.unit_sizes.items()] or [1.0]
    return np.array(out)


def descend(
    residuals: Callable[[Array], Array], x: Array, low: Array, high: Array, widest: Array
) -> tuple[Array, Array]:
    """Return where the sum of squares is least and the Jacobian there, within bounds (Levenberg and Marquardt).

    `x` and its bounds are (n,), the Jacobian (rows, n). No step is wider than `widest` (n,). A point for which
    ConfigError is raised counts as infinitely bad.
    """
    r, damping = residuals(x), 1e-3
    jacobian = slopes(residuals, x, r, low, high)
    for _ in range(_ITERATIONS):
        gradient, normal = jacobian.T @ r, jacobian.T @ jacobian
        step = -np.linalg.lstsq(normal + damping * np.diag(np.diag(normal) + 1e-12), gradient, rcond=None)[0]
        trial = np.clip(x + np.clip(step, -widest, widest), low, high)
        try:
            new = residuals(trial)
        except ConfigError:
            new = np.full(r.size, np.inf)
        before, after = float(r @ r), float(new @ new) if np.all(np.isfinite(new)) else np.inf
        if after < before:
            x, r, damping = trial, new, max(damping / 8.0, 1e-12)
            jacobian = slopes(residuals, x, r, low, high)
            if before - after < _CLOSE + 1e-12 * before:
                break
        else:
            damping *= 6.0
            if damping > 1e9:
                break
    return x, jacobian


def slopes(residuals: Callable[[Array], Array], x: Array, r: Array, low: Array, high: Array) -> Array:
    """Return the Jacobian (rows, n) by one-sided differences, to the side within the bounds."""
    out = np.zeros((r.size, x.size))
    for k in range(x.size):
        for sign in (1.0, -1.0):
            moved = x.copy()
            moved[k] += sign * _STEP * max(abs(x[k]), 1.0)
            if not low[k] <= moved[k] <= high[k]:
                continue
            try:
                out[:, k] = (residuals(moved) - r) / (moved[k] - x[k])
            except ConfigError:
                continue
            break
    return out
