"""Refit in full simulation: nominal parameters and effect parameters together, by Levenberg-Marquardt on whitened residuals.

Screening is right to first order; here the effect acts inside the loop, so large effects, several at once and shapes that screening
held fixed all come out unbiased. Parameters live on scales on which they are of order one: knobs logarithmic, sizes
relative to their natural size, shapes logarithmic where they are positive.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from analysis.diagnosis.candidates import Candidate
from analysis.diagnosis.dataset import Dataset
from analysis.diagnosis.noise import Whitener
from analysis.diagnosis.responses import free_responses
from analysis.diagnosis.tuning import Knob, sensitivities, turned
from sim_backend import layout
from sim_backend.assembly import Places
from sim_backend.effects.base import Effect
from sim_backend.linear import ModalModel, discretise
from sim_backend.replay import replay

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Setting:
    """What stays the same over all refits of one diagnosis."""

    data: Dataset
    nominal: ModalModel
    known: tuple[Effect, ...]
    places: Places
    transducers: layout.Transducers
    knobs: list[Knob]
    whitener: Whitener
    starts: tuple[tuple[Array, ...], ...]
    substeps: int
    workers: int = 2


@dataclass(frozen=True)
class Fit:
    """A fitted hypothesis: `change` of the knobs, the `effects`, and the objective with its parts.

    `misfit` is the whitened sum of squares over the fitted rows, `penalty` the knobs' prior; `covariance` is that of all
    parameters in the order of `names`; `values` in physical units likewise.
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


@dataclass(frozen=True)
class _Scale:
    """How one effect parameter is written on a scale of order one."""

    effect: int
    name: str
    unit: float
    log: bool
    low: float
    high: float

    def bound(self, value: float) -> float:
        if np.isinf(value):
            return value
        if self.log and value <= 0.0:
            return -60.0
        return self.forth(value)

    def forth(self, value: float) -> float:
        return float(np.log(value / self.unit)) if self.log else value / self.unit

    def back(self, x: float) -> float:
        value = self.unit * float(np.exp(np.clip(x, -60.0, 60.0))) if self.log else self.unit * x
        return float(np.clip(value, self.low, self.high))


def refit(setting: Setting, candidates: Sequence[Candidate], sizes: Array, change: Array, iterations: int = 20) -> Fit:
    """Return the best fit of a hypothesis from screened `sizes` (in units of each candidate's columns) and knob `change`.

    A hypothesis that cannot be simulated ends with an infinite misfit.
    """
    scales, start = _parameters(candidates, sizes)
    x = np.concatenate([change, start])
    problem = _Problem(setting, tuple(candidates), scales)
    if x.size:
        low = np.array([-np.inf] * change.size + [s.bound(s.low) for s in scales])
        high = np.array([np.inf] * change.size + [s.bound(s.high) for s in scales])
        found = least_squares(
            problem.stacked,
            np.clip(x, low + 1e-9, high - 1e-9),
            jac=problem.slopes,  # type: ignore[arg-type]
            bounds=(low, high),
            x_scale=np.array([k.sd for k in setting.knobs] + [1.0] * len(scales)),
            max_nfev=iterations,
            ftol=1e-8,
            xtol=1e-10,
            gtol=None,
        )
        x = found.x
    return problem.finish(x, problem.evaluate(x))


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

    def stacked(self, x: Array) -> Array:
        """Return whitened residuals and prior, shape (rows + n_knobs,); huge where the simulation runs away."""
        stacked = self.evaluate(x).stacked
        return stacked if np.all(np.isfinite(stacked)) else np.full(stacked.size, 1e150)

    def slopes(self, x: Array) -> Array:
        """Return the Jacobian of `stacked`."""
        return self.jacobian(x, self.evaluate(x))

    def raw(self, x: Array) -> tuple[Array, ...]:
        """Return the residuals of every record at `x`."""
        s = self.setting
        linear = turned(s.nominal, s.knobs, x[: len(s.knobs)])
        effects = [*s.known, *self.effects(x)]
        out = []
        for record in s.data.records:
            moved = replay(
                linear,
                effects,
                s.places,
                s.transducers,
                record.u,
                s.data.rate_hz,
                temperature_k=record.temperature_k,
                substeps=s.substeps,
            )
            out.append(record.y - moved.reading)
        return tuple(out)

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
        parts = []
        for record, residual, starts in zip(s.data.records, residuals, s.starts, strict=True):
            mask = record.fitted()
            for o in range(s.data.n_outputs):
                white = s.whitener.apply(residual[:, o : o + 1], o)[mask, 0]
                q = starts[o]
                parts.append(white - q @ (q.T @ white))
        return np.concatenate(parts)

    def jacobian(self, x: Array, at: _State) -> Array:
        """Return d(stacked)/dx: knobs by linear sensitivities, effect parameters by finite differences."""
        s = self.setting
        n_knobs = len(s.knobs)
        linear = turned(s.nominal, s.knobs, x[:n_knobs])
        columns = np.zeros((at.stacked.size, x.size))
        if n_knobs:
            per_record = [sensitivities(linear, s.knobs, r.u, s.data.rate_hz) for r in s.data.records]
            for k in range(n_knobs):
                columns[: -n_knobs or None, k] = -self.whiten([p[:, :, k] for p in per_record])
                columns[at.stacked.size - n_knobs + k, k] = 1.0 / s.knobs[k].sd

        def slope(i: int) -> Array:
            step = 1e-4 * max(abs(x[i]), 1e-2)
            shifted = x.copy()
            shifted[i] += step
            return (self.evaluate(shifted).stacked - at.stacked) / step

        with ThreadPoolExecutor(s.workers) as pool:
            for i, column in zip(range(n_knobs, x.size), pool.map(slope, range(n_knobs, x.size)), strict=True):
                columns[:, i] = column
        return columns

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


def start_bases(data: Dataset, nominal: ModalModel, whitener: Whitener) -> tuple[tuple[Array, ...], ...]:
    """Return, per record and output, an orthonormal basis (rows, k) of the whitened free responses of the nominal model."""
    out = []
    for record in data.records:
        free = free_responses(discretise(nominal, data.rate_hz), record.n)
        mask = record.fitted()
        per_output = []
        for o in range(data.n_outputs):
            live = free[:, o][:, np.any(free[:, o] != 0.0, axis=0)]
            q, r = np.linalg.qr(whitener.apply(live, o)[mask])
            size = np.abs(np.diag(r))
            per_output.append(q[:, size > 1e-9 * np.max(size, initial=1e-300)])
        out.append(tuple(per_output))
    return tuple(out)


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
            scale = _Scale(i, p.name, unit, log, p.low, p.high)
            value = float(np.clip(start[p.name], p.low, p.high))
            scales.append(scale)
            x.append(scale.forth(value))
    return scales, np.array(x)
