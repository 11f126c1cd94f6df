"""Refit in full simulation: nominal and effect parameters together, by descent on whitened residuals.

Screening is right to first order; here the effect acts inside the loop, so large effects, several at once and shapes
that screening held fixed all come out unbiased. Parameters live on scales on which they are of order one: knobs
logarithmic, sizes relative to their natural size, shapes logarithmic where they are positive.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.candidates import Candidate
from analysis.diagnosis.dataset import Dataset
from analysis.diagnosis.descent import Descent
from analysis.diagnosis.noise import Whitener
from analysis.diagnosis.starts import Start, stack_white
from analysis.diagnosis.tuning import REACH, Knob, sensitivities, turned
from sim_backend import layout
from sim_backend.assembly import Places
from sim_backend.effects.base import Effect
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel
from sim_backend.replay import Motion, replay

Array = NDArray[np.float64]


KNOB_STEP = 0.2
"""Largest change of a knob in one step: far beyond any tolerance; what a step may do within is left to the damping."""


@dataclass(frozen=True)
class Setting:
    """What stays the same over all refits of one diagnosis; `states` (m, 2) are the starts known so far, per record."""

    data: Dataset
    nominal: ModalModel
    known: tuple[Effect, ...]
    places: Places
    transducers: layout.Transducers
    knobs: list[Knob]
    whitener: Whitener
    starts: tuple[Start, ...]
    states: tuple[Array, ...]
    substeps: int
    workers: int = 2

    @property
    def rows(self) -> int:
        """Number of fitted numbers: rows times outputs."""
        return sum(int(r.fitted().sum()) for r in self.data.records) * self.data.n_outputs


@dataclass(frozen=True)
class Fit:
    """A fitted hypothesis: `change` of the knobs, the `effects`, and the objective with its parts.

    `misfit` is the whitened sum of squares over the fitted rows, `penalty` the knobs' prior; `covariance` is that of
    all parameters in the order of `names`; `values` in physical units likewise.
    """

    candidates: tuple[Candidate, ...]
    change: Array
    effects: tuple[Effect, ...]
    misfit: float
    penalty: float
    rows: int
    names: tuple[tuple[int, str], ...]
    values: Array
    std: Array
    residuals: tuple[Array, ...]

    @property
    def objective(self) -> float:
        """Twice the negative log posterior up to a constant."""
        return self.misfit + self.penalty

    def held(self, keep: Sequence[int] | None = None) -> tuple[list[Candidate], Array]:
        """Return where another refit of these effects (or those numbered in `keep`) starts: shapes and sizes as fitted.

        Sizes are in units of each candidate's columns, joined; an effect without sizes counts as one whole.
        """
        chosen = range(len(self.effects)) if keep is None else keep
        candidates, sizes = [], np.zeros(0)
        for candidate, effect in ((self.candidates[i], self.effects[i]) for i in chosen):
            candidates.append(replace(candidate, shapes={n: getattr(effect, n) for n in candidate.shapes}))
            own = [getattr(effect, n) / unit for n, unit in candidate.unit_sizes.items()] or [1.0]
            sizes = np.append(sizes, own)
        return candidates, sizes


@dataclass(frozen=True)
class _Scale:
    """How one effect parameter is written on a scale of order one."""

    effect: int
    name: str
    unit: float
    log: bool
    size: bool
    low: float
    high: float

    def bound(self, value: float) -> float:
        if np.isinf(value):
            return value
        if self.log and value <= 0.0:
            return -60.0
        return self.forth(value)

    def step(self) -> float:
        """Return how far one step may go: a factor of two on a logarithmic scale, anywhere on a linear one."""
        return 0.7 if self.log else 1e6

    def forth(self, value: float) -> float:
        return float(np.log(value / self.unit)) if self.log else value / self.unit

    def back(self, x: float) -> float:
        value = self.unit * float(np.exp(np.clip(x, -60.0, 60.0))) if self.log else self.unit * x
        return float(np.clip(value, self.low, self.high))


def refit(setting: Setting, candidates: Sequence[Candidate], sizes: Array, change: Array, iterations: int = 25) -> Fit:
    """Return the best fit of a hypothesis from screened `sizes` and knob `change`.

    `sizes` are in units of each candidate's columns.

    A hypothesis that cannot be simulated ends with an infinite misfit.
    """
    scales, start = _parameters(candidates, sizes)
    problem = _Problem(setting, tuple(candidates), scales)
    n_knobs, sd = change.size, np.array([k.sd for k in setting.knobs])
    descent = Descent(
        problem.evaluate,
        problem.normal,
        np.concatenate([-REACH * sd, [s.bound(s.low) for s in scales]]),
        np.concatenate([REACH * sd, [s.bound(s.high) for s in scales]]),
        np.array([KNOB_STEP] * n_knobs + [s.step() for s in scales]),
    )
    x = np.concatenate([change, start])
    if not np.isfinite(problem.evaluate(x).misfit):
        # screening asked for what cannot be: begin where the effect adds nothing
        x[n_knobs:] = [0.0 if scale.size else value for scale, value in zip(scales, start, strict=True)]
    x, found = descent.run(x, iterations)
    return problem.finish(x, found)


@dataclass(frozen=True)
class _State:
    stacked: Array
    residuals: tuple[Array, ...]
    misfit: float
    penalty: float

    @property
    def objective(self) -> float:
        return self.misfit + self.penalty


@dataclass(frozen=True)
class _Problem:
    setting: Setting
    candidates: tuple[Candidate, ...]
    scales: list[_Scale]

    def effects(self, x: Array) -> tuple[Effect, ...]:
        n_knobs = len(self.setting.knobs)
        values: list[dict[str, float]] = [{} for _ in self.candidates]
        for scale, xi in zip(self.scales, x[n_knobs:], strict=True):
            values[scale.effect][scale.name] = scale.back(float(xi))
        return tuple(c.effect(c.where, **v) for c, v in zip(self.candidates, values, strict=True))

    def normal(self, x: Array, at: _State) -> tuple[Array, Array]:
        """Return the normal equations at `x`."""
        jacobian = self.jacobian(x, at)
        return jacobian.T @ jacobian, -jacobian.T @ at.stacked

    def raw(self, x: Array) -> tuple[Array, ...]:
        """Return the residuals of every record at `x`, infinite where the model cannot be (a negative delay, say)."""
        s = self.setting
        linear = turned(s.nominal, s.knobs, x[: len(s.knobs)])
        try:
            moved = simulated(s, linear, self.effects(x))
        except ConfigError:
            return tuple(np.full(record.y.shape, np.inf) for record in s.data.records)
        return tuple(record.y - m.reading for record, m in zip(s.data.records, moved, strict=True))

    def evaluate(self, x: Array) -> _State:
        with np.errstate(over="ignore", invalid="ignore"):
            residuals = self.raw(x)
            white = self.whiten(residuals)
        prior = x[: len(self.setting.knobs)] / np.array([k.sd for k in self.setting.knobs])
        stacked = np.concatenate([white, prior])
        misfit = float(white @ white)
        if not np.isfinite(misfit):
            misfit = np.inf
        return _State(stacked, residuals, misfit, float(prior @ prior))

    def whiten(self, residuals: Sequence[Array]) -> Array:
        """Return all fitted rows, whitened, each record's unknown start projected out."""
        s = self.setting
        return np.concatenate(
            [
                start.project(stack_white(s.whitener, record, residual[:, :, None])[:, 0])
                for record, residual, start in zip(s.data.records, residuals, s.starts, strict=True)
            ]
        )

    def jacobian(self, x: Array, at: _State) -> Array:
        """Return d(stacked)/dx by central differences of the full simulation.

        Knobs of modes that no effect touches keep their linear sensitivities, which are exact there. For the others a
        linear approximation would not do: where two knobs nearly do the same, the valley they span must be known to
        far better than the size of the effect, or no step along it can be taken.
        """
        s = self.setting
        n_knobs = len(s.knobs)
        columns = np.zeros((at.stacked.size, x.size))
        touched = np.array([self.touches(k) for k in s.knobs], dtype=bool)
        easy = [i for i in range(n_knobs) if not touched[i]]
        if easy:
            linear = turned(s.nominal, s.knobs, x[:n_knobs])
            per_record = [
                sensitivities(linear, [s.knobs[i] for i in easy], r.u, s.data.rate_hz) for r in s.data.records
            ]
            for k, i in enumerate(easy):
                columns[: at.stacked.size - n_knobs, i] = -self.whiten([p[:, :, k] for p in per_record])
                columns[at.stacked.size - n_knobs + i, i] = 1.0 / s.knobs[i].sd

        def slope(i: int) -> Array:
            step = 1e-5 if i < n_knobs else _difference(x[i])
            there, back = _beside(x, i, step)
            up, down = self.evaluate(there), self.evaluate(back)
            if not np.isfinite(down.misfit):
                return (up.stacked - at.stacked) / step
            if not np.isfinite(up.misfit):
                return (at.stacked - down.stacked) / step
            return (up.stacked - down.stacked) / (2.0 * step)

        hard = [i for i in range(x.size) if i not in easy]
        with ThreadPoolExecutor(s.workers) as pool:
            for i, column in zip(hard, pool.map(slope, hard), strict=True):
                columns[:, i] = column
        return columns

    def touches(self, knob: Knob) -> bool:
        """Tell whether an effect acts on, or through, the mode of this knob."""
        s = self.setting
        inputs = {s.places.inputs[j] for j in range(s.nominal.n_inputs) if s.nominal.b[knob.mode, j] != 0.0}
        outputs = {s.places.outputs[o] for o in range(s.nominal.n_outputs) if s.nominal.c[o, knob.mode] != 0.0}
        acting = [c.where for c in self.candidates] + [e.where for e in s.known]
        names = {name for where in acting for name in where.split("->")}
        return bool(names & (inputs | outputs)) or not names <= {*s.places.inputs, *s.places.outputs}

    def finish(self, x: Array, at: _State) -> Fit:
        n_knobs = len(self.setting.knobs)
        jacobian = self.jacobian(x, at)
        spread = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
        covariance = np.linalg.pinv((jacobian / spread).T @ (jacobian / spread), rcond=1e-12) / np.outer(spread, spread)
        effects = self.effects(x)
        values = np.array([getattr(effects[s.effect], s.name) for s in self.scales])
        deviation = np.sqrt(np.maximum(np.diag(covariance)[n_knobs:], 0.0))
        std = np.array(
            [d * (abs(v) if s.log else abs(s.unit)) for d, v, s in zip(deviation, values, self.scales, strict=True)]
        )
        return Fit(
            self.candidates,
            x[:n_knobs],
            effects,
            at.misfit,
            at.penalty,
            at.stacked.size - n_knobs,
            tuple((s.effect, s.name) for s in self.scales),
            values,
            std,
            at.residuals,
        )


def simulated(setting: Setting, linear: ModalModel, effects: Sequence[Effect]) -> list[Motion]:
    """Return every record replayed through `linear` with the known effects and `effects`."""
    return [
        replay(
            linear,
            [*setting.known, *effects],
            setting.places,
            setting.transducers,
            record.u,
            setting.data.rate_hz,
            temperature_k=record.temperature_k,
            start=states,
            substeps=setting.substeps,
        )
        for record, states in zip(setting.data.records, setting.states, strict=True)
    ]


def positions(setting: Setting, fit: Fit) -> list[Array]:
    """Return the true positions (n, n_y) of every record under a fit."""
    return [m.position for m in simulated(setting, turned(setting.nominal, setting.knobs, fit.change), fit.effects)]


def exact_sensitivities(setting: Setting, fit: Fit) -> tuple[Array, ...]:
    """Return, per record, the outputs' change per unit of each knob and each effect parameter, (n, n_y, k).

    By central differences of the full simulation: what is screened beside these columns is compared with noise, and
    an error of a thousandth in a knob's column can be far above it.
    """
    held, sizes = fit.held()
    scales, x = _parameters(held, sizes)
    problem = _Problem(setting, tuple(held), scales)
    x = np.concatenate([fit.change, x])

    def column(i: int) -> list[Array]:
        step = 1e-5 if i < fit.change.size else _difference(x[i])
        there, back = (problem.raw(side) for side in _beside(x, i, step))
        width = 2.0 * step
        if not all(np.isfinite(b).all() for b in back):
            back, width = fit.residuals, step
        elif not all(np.isfinite(t).all() for t in there):
            there, width = fit.residuals, step
        return [(b - t) / width for b, t in zip(back, there, strict=True)]

    with ThreadPoolExecutor(setting.workers) as pool:
        columns = list(pool.map(column, range(x.size)))
    return tuple(np.stack([c[r] for c in columns], axis=2) for r in range(len(setting.data.records)))


def _beside(x: Array, i: int, step: float) -> tuple[Array, Array]:
    """Return `x` with parameter `i` a step further and a step back."""
    there, back = x.copy(), x.copy()
    there[i], back[i] = x[i] + step, x[i] - step
    return there, back


def _difference(x: float) -> float:
    """Return a step for finite differences of a parameter of order one: far above rounding, far below its own size."""
    return 1e-4 * max(abs(x), 1e-2)


def _parameters(candidates: Sequence[Candidate], sizes: Array) -> tuple[list[_Scale], Array]:
    scales: list[_Scale] = []
    x: list[float] = []
    at = 0
    for i, candidate in enumerate(candidates):
        start = dict(candidate.shapes)
        width = max(len(candidate.unit_sizes), 1)
        start |= {n: sizes[at + k] * unit for k, (n, unit) in enumerate(candidate.unit_sizes.items())}
        at += width
        for p in candidate.effect.parameters():
            if p.name not in start:
                continue
            log = (not p.size) and p.log and start[p.name] > 0.0
            unit = (
                candidate.unit_sizes.get(p.name, 1.0)
                if p.size
                else (start[p.name] if log else max(abs(start[p.name]), 1e-12))
            )
            scale = _Scale(i, p.name, unit, log, p.size, p.low, p.high)
            value = float(np.clip(start[p.name], p.low, p.high))
            scales.append(scale)
            x.append(scale.forth(value))
    return scales, np.array(x)
