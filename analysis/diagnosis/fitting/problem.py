"""A hypothesis as a function of its parameters: what it leaves of the data, how that changes, and what a fit is.

Everything is in full simulation; `analysis.diagnosis.fitting.slopes` has the derivatives a descent goes along.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
import scipy

from analysis.diagnosis.candidates.parameters import Scale, parameters_of
from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.descent import Descent, Slopes, approached, inverse_of, sharpened
from analysis.diagnosis.fitting.fit import Fit, Setting, case_of, residuals_of, simulated_together
from analysis.diagnosis.fitting.starts import Start, stack_white
from analysis.diagnosis.nominal.responses import coasting, simulate
from analysis.diagnosis.nominal.tuning import bounds_of, factor_of, root_of, turned
from analysis.diagnosis.records.dataset import Record
from sim_backend.effects.base import Effect
from sim_backend.errors import ConfigError
from sim_backend.kernel.structure import LANES
from sim_backend.linear import Array, played
from sim_backend.replay import Case

_NUISANCE_STEP = 0.2
"""Largest change of a nuisance in one step: far beyond any tolerance; what a step may do within is left to the
descent."""

_NUISANCE_DIFFERENCE = 1e-6
"""A mode's answer to its nuisance bends within its width, so a difference this small is right to 1e-6 of a mode's
quality factor, while rounding leaves 1e-7 of it."""

_HALVINGS = 4

_WILD, _CYCLES = 10.0, 10.0
"""Times the largest of readings and linear model above which a simulation is of no use: it is self-excited. A mode of
fewer cycles in a record drifts as far by a small error of a torque or of its start."""

_ROOF, _ROUNDS, _FOLLOWING, _GAINED = 0.01, 3, 4, 0.1
"""How far from where a descent ended a cusp is sought, on its parameter's scale; how often, with how many steps of all
else in between; and the gain (twice a log-likelihood) below which that ends."""


def together(which: Sequence[int]) -> list[Sequence[int]]:
    """Return the parameters `which` in groups of as many as are simulated in the time of little more than one."""
    return [which[first : first + LANES] for first in range(0, len(which), LANES)]


@dataclass(frozen=True)
class Point:
    """One simulation of a hypothesis: whitened rows above prior deviations, and what they were made from."""

    stacked: Array
    residuals: tuple[Array, ...]
    torques: tuple[Array, ...]
    misfit: float
    penalty: float

    @property
    def objective(self) -> float:
        """Twice the negative log posterior up to a constant."""
        return self.misfit + self.penalty


@dataclass(frozen=True)
class Problem:
    """A hypothesis as a function of its parameters x (n,): changes of nuisances, then effects' on their scales."""

    setting: Setting
    candidates: tuple[Candidate, ...]
    scales: list[Scale]

    @classmethod
    def of(cls, setting: Setting, candidates: Sequence[Candidate], sizes: Array) -> tuple[Self, Array]:
        """Return the problem of a hypothesis, and its effects' scaled parameters (p,) at `sizes`: see `refit`."""
        scales, start = parameters_of(candidates, sizes)
        return cls(setting, tuple(candidates), scales), start

    def effects(self, x: Array) -> tuple[Effect, ...]:
        """Return the effects with the parameters in `x` (n,)."""
        n_nuisances = len(self.setting.nuisances)
        values = [dict(c.shapes) for c in self.candidates]  # constants among them: no fit moves those
        for scale, xi in zip(self.scales, x[n_nuisances:], strict=True):
            values[scale.effect][scale.name] = scale.back(float(xi))
        return tuple(c.effect(c.where, **v, **c.given) for c, v in zip(self.candidates, values, strict=True))

    def raw(self, x: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        """Return residuals (n, n_y) and torques (n, n_u) of every record at `x`.

        Residuals are infinite where the model cannot be (a delay below 0), or swings far beyond all that was seen.
        """
        return self._raw([x])[0]

    def _raw(self, places: Sequence[Array]) -> list[tuple[tuple[Array, ...], tuple[Array, ...]]]:
        """Return the same at several places."""
        s, there = self.setting, dict[int, Case]()
        for i, x in enumerate(places):
            with suppress(ConfigError):
                linear = turned(s.nominal, s.nuisances, x[: len(s.nuisances)])
                there[i] = case_of(s, linear, self.effects(x))
        found = dict(zip(there, simulated_together(s, list(there.values()), self._farthest), strict=True))
        nowhere = tuple(np.full(r.y.shape, np.inf) for r in s.data.records), tuple(r.u for r in s.data.records)
        return [
            (residuals_of(s.data.records, found[i]), tuple(m.torque for m in found[i])) if i in found else nowhere
            for i in range(len(places))
        ]

    @cached_property
    def _farthest(self) -> list[Array]:
        """Largest readings of each record in a simulation of any use, (n_y,); infinite where a slow mode may drift."""
        s = self.setting
        model, limits = played(s.nominal, s.data.rate_hz), []
        for record, states in zip(s.data.records, s.states, strict=True):
            linear = simulate(model, record.u) + coasting(model, states[: s.nominal.n_blocks], record.n)
            limit = _WILD * np.max(np.abs(np.stack([record.y, linear])), axis=(0, 1))
            slow = s.nominal.omega_rad_s * record.n / s.data.rate_hz < 2.0 * np.pi * _CYCLES
            limits.append(np.where(np.any(s.nominal.c[:, slow] != 0.0, axis=1), np.inf, limit))
        return limits

    def evaluate(self, x: Array) -> Point:
        """Simulate at `x` (n,) and return what it leaves; the misfit is infinite where nothing can be simulated."""
        with np.errstate(over="ignore", invalid="ignore"):
            residuals, torques = self.raw(x)
            white = self.whiten(residuals)
            misfit = float(white @ white)
        prior = self.root @ (x - np.concatenate([np.zeros(len(self.setting.nuisances)), [s.mean for s in self.scales]]))
        stacked = np.concatenate([white, prior])
        return Point(stacked, residuals, torques, misfit if np.isfinite(misfit) else np.inf, float(prior @ prior))

    @cached_property
    def factor(self) -> Array:
        """The lower factor U (n, n) of the covariance U U' of all parameters before the data speak."""
        return np.asarray(
            scipy.linalg.block_diag(factor_of(self.setting.nuisances), np.diag([s.sd for s in self.scales]))
        )

    @cached_property
    def root(self) -> Array:
        """The inverse (n, n) of `factor`: it makes unit white numbers of the parameters' distances from their means."""
        return np.asarray(
            scipy.linalg.block_diag(root_of(self.setting.nuisances), np.diag([1.0 / s.sd for s in self.scales]))
        )

    def slopes(self, x: Array, which: Sequence[int], here: Sequence[Array]) -> list[tuple[Array, ...] | None]:
        """Return d(residuals)/dx_i for each i of `which` by a difference to those `here`, all simulated together.

        Both are (n, n_y) per record. The difference goes back where nothing lies ahead; there is none where no model is
        on either side.
        """
        ahead, found = [self._difference(x, i) for i in which], dict[int, tuple[Array, ...]]()
        for turn in (1.0, -1.0):
            left = [(i, turn * step) for i, step in zip(which, ahead, strict=True) if i not in found]
            moved = self._raw([_with(x, i, float(x[i]) + step) for i, step in left]) if left else []
            for (i, step), (there, _) in zip(left, moved, strict=True):
                if all(np.isfinite(r).all() for r in there):
                    found[i] = tuple((b - a) / step for b, a in zip(there, here, strict=True))
        return [found.get(i) for i in which]

    def near(self, x: Array, i: int) -> tuple[Effect, float]:
        """Return the effect of parameter `i` with that a small step away from `x` (n,), and the step."""
        step = self._difference(x, i)
        which = self.scales[i - len(self.setting.nuisances)].effect
        return self.effects(_with(x, i, float(x[i]) + step))[which], step

    def _difference(self, x: Array, i: int) -> float:
        """Return the small step of parameter `i` from `x` that is tried first."""
        own = i - len(self.setting.nuisances)
        if own < 0:
            return _NUISANCE_DIFFERENCE
        size = self.scales[own].difference(float(x[i]))
        return -size if x[i] + size > self.scales[own].bound(self.scales[own].high) else size

    def whiten(self, residuals: Sequence[Array]) -> Array:
        """Return all fitted samples of (n, n_y) or (n, n_y, k) per record, whitened, unknown starts projected out."""
        s = self.setting

        def white(record: Record, values: Array, start: Start) -> Array:
            return start.project(stack_white(s.whitener, record, values.reshape(record.n, values.shape[1], -1)))

        return np.concatenate(s.each(white, s.data.records, residuals, s.starts)).squeeze()

    def shortened(self, x: Array) -> Array:
        """Return `x` (n,) with nuisances and sizes halved until it fits better than the model, at most four times."""
        some = np.array([True] * len(self.setting.nuisances) + [s.size for s in self.scales])
        nothing = np.where(some, 0.0, x)
        without = self.evaluate(nothing).misfit
        return halved(x, nothing, lambda there: self.evaluate(there).misfit < without)

    def descend(self, slopes: Slopes[Point], x: Array, steps: int, *, exact: bool = True) -> tuple[Array, Point]:
        """Return the best point (n,) from `x` (n,) along `slopes`, and its simulation."""
        least, most = bounds_of(self.setting.nuisances)
        descent = Descent(
            self.evaluate,
            slopes,
            np.concatenate([least, [s.bound(s.low) for s in self.scales]]),
            np.concatenate([most, [s.bound(s.high) for s in self.scales]]),
            np.array([_NUISANCE_STEP] * most.size + [s.step() for s in self.scales]),
            self.setting.rows,
            exact=exact,
        )
        return descent.run(x, steps)

    def at_cusps(self, slopes: Slopes[Point], x: Array, at: Point) -> tuple[Array, Point, dict[int, float]]:
        """Return the best point near `x` where a parameter's misfit has a cusp, and the deviations of such parameters.

        `x` and the point are (n,). What else is fitted follows, and the cusp with it, until neither gains.
        """
        deviations: dict[int, float] = {}
        # as in a descent: where far more than noise is left, so much more is no gain
        close = _GAINED * max(1.0, at.objective / self.setting.rows)
        for i in (len(self.setting.nuisances) + k for k, s in enumerate(self.scales) if s.cusp):
            for _ in range(_ROUNDS):
                before = at.objective
                x = _with(x, i, approached(*self._cusp(x, i, close)))
                x, at = self.descend(slopes, x, _FOLLOWING)
                if before - at.objective < close:
                    break
            there, deviations[i] = sharpened(*self._cusp(x, i, close))
            x = _with(x, i, there)
            at = self.evaluate(x)
        return x, at, deviations

    def _cusp(self, x: Array, i: int, close: float) -> tuple[Callable[[float], float], float, float, float]:
        """Return the objective over parameter `i`, its value, how far to seek a cusp, and the least gain."""
        grain = self.scales[i - len(self.setting.nuisances)].grain
        return (lambda value: self.evaluate(_with(x, i, value)).objective), float(x[i]), max(_ROOF, 2.0 * grain), close

    def finish(self, x: Array, at: Point, jacobian: Array, deviations: Mapping[int, float]) -> Fit:
        """Return the fit at `x` (n,), its standard deviations from `jacobian` (rows + n, n).

        Some `deviations` may be known otherwise.
        """
        n_nuisances = len(self.setting.nuisances)
        factor = self.factor
        # beside a parameter whose column is not finite there is no model: the data say nothing of it
        data = np.where(np.isfinite(jacobian).all(axis=0), jacobian[: at.stacked.size - x.size], 0.0)
        # the slope on one side of a cusp is that of a gain, and says nothing of how far its parameter is known
        known = np.zeros(x.size)
        for i, sure in deviations.items():
            data[:, i], known[i] = 0.0, 1.0 / sure
        seen = data.T @ data + np.diag(known**2)
        precision = factor.T @ seen @ factor + np.eye(x.size)  # in the prior's units
        covariance = factor @ inverse_of(precision) @ factor.T
        effects = self.effects(x)
        rows = at.stacked.size - x.size
        occam = 0.5 * float(np.linalg.slogdet(self._narrowed(x, seen))[1]) + self._chosen(x, seen, effects)
        values = np.array([getattr(effects[s.effect], s.name) for s in self.scales])
        deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        own = zip(deviation[n_nuisances:], values, self.scales, strict=True)
        std = [d * (abs(v) if s.log else abs(s.unit)) for d, v, s in own]
        told = [(i, name, sd) for i, c in enumerate(self.candidates) for name, sd in c.told.items()]
        names = (*((s.effect, s.name) for s in self.scales), *((i, name) for i, name, _ in told))
        values = np.append(values, [getattr(effects[i], name) for i, name, _ in told])
        std += [sd for _, _, sd in told]
        return Fit(
            self.candidates,
            x[:n_nuisances],
            effects,
            at.misfit,
            at.penalty,
            rows,
            occam,
            self.setting.log_variance,
            names,
            values,
            np.array(std),
            at.residuals,
            self.setting.states,
            deviation[:n_nuisances],
        )

    def _narrowed(self, x: Array, seen: Array) -> Array:
        """Return the posterior's precision in units of the prior's: one where that of the data, `seen` (n, n), is zero.

        How large an effect may be nobody knows beforehand, so its sizes share one scale, which is that of the largest;
        a shape that measures its effect has its own.
        """
        n_nuisances = len(self.setting.nuisances)
        factor = self.factor
        sd = np.diag(factor)
        unit, more = sd.copy(), np.zeros(x.size)
        for i, s in enumerate(self.scales):
            if s.size:
                own = [
                    abs(x[n_nuisances + k])
                    for k, other in enumerate(self.scales)
                    if other.size and other.effect == s.effect
                ]
                unit[n_nuisances + i], more[n_nuisances + i] = max(own), 1.0
            elif s.measures:  # on its logarithm the own size is one
                unit[n_nuisances + i], more[n_nuisances + i] = 1.0, 1.0
        scaled = factor * (unit / sd)
        return np.asarray(scaled.T @ seen @ scaled + np.diag((unit / sd) ** 2 + more))

    def _chosen(self, x: Array, seen: Array, effects: Sequence[Effect]) -> float:
        """Return the price of phases that were chosen by looking at the data, `seen` being their precision (n, n).

        A phase in radians is known to σ = 1/z by a run that holds z² of the effect's energy, and was anywhere on a
        circle before: narrowed by 2π / (√(2π) σ) = √(2π) z. The energy is taken to be the same in every run.
        """
        n_nuisances, price = len(self.setting.nuisances), 0.0
        for i, effect in enumerate(effects):
            count = effect.chosen()
            if count:
                own = [n_nuisances + k for k, s in enumerate(self.scales) if s.size and s.effect == i]
                energy = float(x[own] @ seen[np.ix_(own, own)] @ x[own]) / (count + 1)
                price += 0.5 * count * math.log1p(2.0 * math.pi * energy)
        return price


def halved(start: Array, nothing: Array, good: Callable[[Array], bool]) -> Array:
    """Return `start` (n,), its way from `nothing` (n,) halved until it is `good`, at most four times."""
    for _ in range(_HALVINGS):
        if good(start):
            break
        start = 0.5 * (start + nothing)
    return start


def _with(x: Array, i: int, value: float) -> Array:
    there = x.copy()
    there[i] = value
    return there
