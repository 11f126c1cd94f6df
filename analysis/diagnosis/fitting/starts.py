"""The unknown state in which each record starts: projected out of everything, and estimated for the simulation.

So are zeros of readings that nobody knows. What identification says of them was fitted beside whatever the model lacks:
a loop or a spring that is stiffer to one side moves the mean.

What a start can add to the outputs is linear in it, so it is eliminated exactly from every regression; only where an
effect is large does the start have to be known in the simulation itself, and there it follows from the same projection.
A record that no fit has seen may begin far from where its start is that of a linear model: its start is fitted to the
simulation itself, by as many numbers whatever acts (Levenberg 1944, Marquardt 1963).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.nominal.responses import answers_to_before, coasting, free_responses
from analysis.diagnosis.records.dataset import Dataset, Record
from sim_backend.linear import Array, DiscreteModel, ModalModel, played

_NEGLIGIBLE = 1e-9
"""A direction this much weaker than the strongest cannot be distinguished from rounding and is not adjusted."""

_FORGOTTEN = 1e-6
"""A start that has decayed below this when the fitted samples begin is not fitted: it would have to be enormous."""

_STEPS, _WORTH_A_STEP = 24, 0.99
"""Steps in which a start is fitted, while each leaves less than this part of the squares."""

_FIRST, _STEPS_EACH = 4, 6
"""First samples that a start is sought on, for each of its numbers, and steps there and on each twice as many."""

_TOGETHER = 8
"""Starts that are simulated together at most: each takes as much memory as the record."""

_NUDGE = 1e-4
"""By what part of its size an output is moved at most to see its slope: far above rounding, far below any effect."""

_DAMPED, _DAMPINGS = 1e-6, 8
"""First damping of a step, in squares of what a start adds, and how often it is made ten times larger at most."""


@dataclass(frozen=True)
class Start:
    """What a record's start can add: an orthonormal basis `q` (rows, k), whitened.

    `back` (2 m, k) gives the states, `before` (b, k) the commands still within a delay, then unknown zeros.
    """

    q: Array
    back: Array
    before: Array

    def project(self, white: Array) -> Array:
        """Return `white` (rows, …) without what a start can explain, its columns as they lie in memory."""
        return np.asarray(white - ((self.q.T @ white).T @ self.q.T).T)

    def states(self, white: Array) -> Array:
        """Return the modal states (m, 2) that explain `white` (rows,) best."""
        return np.asarray((self.back @ (self.q.T @ white)).reshape(-1, 2), dtype=float)


def stack_white(whitener: Whitener, record: Record, values: Array) -> Array:
    """Return the fitted samples of `values` (n, n_y, k), whitened, outputs stacked: (n_y · rows, k)."""
    mask = record.fitted()
    return record.weight * np.concatenate([whitener.rows(values[:, o], mask, o) for o in range(values.shape[1])])


def start_of(record: Record, linear: ModalModel, whitener: Whitener, rate_hz: float) -> Start:
    """Return the start basis of one record: of the modes of `linear`, and of what may be there beside them."""
    model = played(linear, rate_hz)
    free, late = free_responses(model, record.n), beside_states(model, record)
    white = stack_white(whitener, record, free)
    seen, whole = (np.linalg.norm(part, axis=(0, 1)) for part in (free[record.fitted()], free))
    white[:, seen < _FORGOTTEN * whole] = 0.0
    states, back = _basis(white, np.linalg.norm(white, axis=0))
    # only the first samples distinguish commands within a delay from free motion: the states explain most by themselves
    white = stack_white(whitener, record, late)
    commands, before = _basis(white - states @ (states.T @ white), np.linalg.norm(white, axis=0))
    back, before = np.pad(back, ((0, 0), (0, commands.shape[1]))), np.pad(before, ((0, 0), (states.shape[1], 0)))
    return Start(np.concatenate([states, commands], axis=1), back, before)


def beside_states(model: DiscreteModel, record: Record) -> Array:
    """Return what a record may begin with beside the modal states, (n, n_y, k): commands within a delay, zeros."""
    return np.concatenate([answers_to_before(model, record.n), record.zeros()], axis=2)


def _basis(columns: Array, scale: Array) -> tuple[Array, Array]:
    """Return an orthonormal basis (rows, k) of columns (rows, c) of some `scale`, and what gives them back (c, k).

    A column that is far below its scale is the rounding of one that another basis spans.
    """
    scale = np.where(scale > 0.0, scale, 1.0)
    left, size, right = np.linalg.svd(columns / scale, full_matrices=False)
    keep = size > _NEGLIGIBLE * np.max(size, initial=1.0)
    return left[:, keep], (right[keep].T / size[keep]) / scale[:, None]


def without_starts(
    data: Dataset, linear: ModalModel, whitener: Whitener, residuals: Sequence[Array]
) -> tuple[Array, ...]:
    """Return `residuals`, (n, n_y) per record, less what a start of every mode of `linear` explains of them."""
    model = played(linear, data.rate_hz)

    def rest(record: Record, start: Start, residual: Array) -> Array:
        white = stack_white(whitener, record, residual[:, :, None])[:, 0]
        left = residual - beside_states(model, record) @ (start.before @ (start.q.T @ white))
        states = start.states(stack_white(whitener, record, left[:, :, None])[:, 0])
        return left - coasting(model, states, record.n)

    starts = starts_of(data, linear, whitener)
    return tuple(rest(*each) for each in zip(data.records, starts, residuals, strict=True))


def zeros_left(
    data: Dataset, starts: Sequence[Start], whitener: Whitener, residuals: Sequence[Array]
) -> dict[int, tuple[float, float]]:
    """Return the estimate of each free zero of `data` from `residuals`, (n, n_y) per record: value and deviation.

    Records count by how well they determine it; a zero that none determines is left out.
    """
    weighted, weights = defaultdict[int, float](float), defaultdict[int, float](float)
    for record, start, residual in zip(data.records, starts, residuals, strict=True):
        back = start.before[start.before.shape[0] - len(record.free_zeros) :]
        values = back @ (start.q.T @ stack_white(whitener, record, residual[:, :, None])[:, 0])
        for output, value, variance in zip(record.free_zeros, values, np.sum(back**2, axis=1), strict=True):
            if variance > 0.0:
                weighted[output] += float(value / variance)
                weights[output] += float(1.0 / variance)
    return {output: (weighted[output] / weight, weight**-0.5) for output, weight in weights.items()}


def starts_of(data: Dataset, linear: ModalModel, whitener: Whitener) -> tuple[Start, ...]:
    """Return the start basis of every record."""
    return tuple(start_of(r, linear, whitener, data.rate_hz) for r in data.records)


LeftFrom = Callable[[Sequence[Array], int], list[Array]]
"""What a simulation leaves, (m, n_y) each, from each of some starts (k,) over so many first samples m."""


def left_by_best_start(
    left: LeftFrom,
    bare: LeftFrom,
    columns: Array,
    weight: Array,
    spread: Array,
    *,
    exact: bool,
) -> Array:
    """Return the residual of a simulation, (n, n_y), from the start (k,) that minimises it over weighted samples.

    `spread` (k,) is how large each number of the start is likely to be: zero where it is known to be none, without
    bound where nothing is known of it. `left` gives the residuals from any starts over so many first samples, `bare`
    those without what acts on the motion, `columns` (n, n_y, k) what starts add then; where nothing acts, that is
    `exact`. A torque that depends on the motion changes the motion from a start, and beside a stop or in slack, steps
    along `columns` lead away from it. So the slopes are those of the simulation at the start itself, which is also
    fitted to the first samples, then to ever more of them: the immediate effect of a start depends least on what acts
    later.
    """
    fit = _StartFit(left, columns, weight, spread)
    rest = np.zeros(columns.shape[2])
    alone = fit.linear(*bare([rest], fit.rows))
    if exact:
        return left([alone], fit.rows)[0]
    begins = [alone, rest, fit.grown(alone), fit.grown(rest)]
    tried = zip(begins, left(begins, fit.rows), strict=True)
    start, residual = min(tried, key=lambda one: _squares(fit.weighed(one[1])))
    return fit.refined(start, residual, _STEPS)[1]


@dataclass(frozen=True)
class _StartFit:
    """A start (k,) that is fitted to the samples of some `weight` (n, n_y); see `left_by_best_start`."""

    left: LeftFrom
    columns: Array
    weight: Array
    spread: Array

    @property
    def rows(self) -> int:
        """Number of all samples."""
        return int(self.weight.shape[0])

    @cached_property
    def inverse(self) -> Array:
        """One over the size (k,) of what each number of the start adds, nothing for what adds nothing."""
        scale = np.linalg.norm(self.columns * self.weight[:, :, None], axis=(0, 1))
        return np.divide(1.0, scale, out=np.zeros_like(scale), where=self._remembered)

    @cached_property
    def nudges(self) -> Array:
        """By how much each number (k,) is moved to see its slope."""
        peak = np.max(np.abs(self.columns * self.weight[:, :, None]), axis=(0, 1))
        return np.divide(_NUDGE, peak, out=np.zeros_like(peak), where=self._remembered)

    @cached_property
    def _remembered(self) -> NDArray[np.bool_]:
        """Which numbers of the start (k,) still matter in samples of some weight: the motion of others has died out."""
        seen = np.linalg.norm(self.columns * (self.weight > 0.0)[:, :, None], axis=(0, 1))
        whole = np.linalg.norm(self.columns, axis=(0, 1))
        return np.asarray((whole > 0.0) & (seen >= _FORGOTTEN * whole))

    def weighed(self, values: Array) -> Array:
        """Return first samples of readings (m, n_y) or of columns (m, n_y, k), weighted, as (m n_y,) or (…, k)."""
        weight = self.weight[: values.shape[0]]
        return np.asarray((values * weight[(...,) + (None,) * (values.ndim - 2)]).reshape(-1, *values.shape[2:]))

    def linear(self, residual: Array) -> Array:
        """Return the likeliest start (k,) beside a `residual` (n, n_y) where nothing acts.

        Successive commands within a delay nearly cancel: those that minimise the noise in the first samples may be
        hundreds of times what was ever played, and no simulation in steps follows that.
        """
        known = np.isfinite(self.spread)
        # in units of what is likely, so that what is known to be nothing has no column instead of a boundless weight
        unit = np.where(known, self.spread, self.inverse)
        own, left = self.weighed(self.columns) * unit, self.weighed(residual)
        start = np.linalg.lstsq(own, left, rcond=_NEGLIGIBLE)[0]
        rows = max(int(np.count_nonzero(self.weight)) - start.size, 1)
        noise = float(np.linalg.norm(left - own @ start)) / rows**0.5
        likely = np.diag(np.where(known, noise, 0.0))
        start = np.linalg.lstsq(np.vstack([own, likely]), np.append(left, np.zeros(start.size)), rcond=_NEGLIGIBLE)[0]
        return np.asarray(unit * start)

    def grown(self, start: Array) -> Array:
        """Return a start that was fitted to the first samples, then to twice as many, up to half of them."""
        used = np.cumsum(np.any(self.weight > 0.0, axis=1))
        count = _FIRST * start.size
        while 2 * count < used[-1]:
            (residual,) = self.left([start], int(np.searchsorted(used, count)) + 1)
            start, _ = self.refined(start, residual, _STEPS_EACH)
            count *= 2
        return start

    def refined(self, start: Array, residual: Array, steps: int) -> tuple[Array, Array]:
        """Return a start that reduces `residual` (m, n_y) of the first samples, and the new residual, in `steps`."""
        weighed, damping = self.weighed(residual), _DAMPED
        for _ in range(steps):
            slopes = self._slopes(start, residual)
            before = _squares(weighed)
            if not np.all(np.isfinite(slopes)):
                break
            own = self.weighed(slopes) * self.inverse
            for _ in range(_DAMPINGS):
                there = start + self.inverse * _damped_step(own, weighed, damping)
                (after,) = self.left([there], residual.shape[0])
                if _squares(self.weighed(after)) < before:
                    start, residual, weighed, damping = there, after, self.weighed(after), damping / 10.0
                    break
                damping *= 10.0
            if not _squares(weighed) < _WORTH_A_STEP * before:
                break
        return start, residual

    def _slopes(self, start: Array, residual: Array) -> Array:
        slopes = np.zeros((*residual.shape, start.size))
        live = np.flatnonzero(self.nudges)
        for some in (live[first : first + _TOGETHER] for first in range(0, live.size, _TOGETHER)):
            nudged = [start + self.nudges[k] * (np.arange(start.size) == k) for k in some]
            for k, moved in zip(some, self.left(nudged, residual.shape[0]), strict=True):
                slopes[:, :, k] = (residual - moved) / self.nudges[k]
        return slopes


def _squares(values: Array) -> float:
    """Return the sum of squares, without bound where a simulation has none."""
    with np.errstate(over="ignore", invalid="ignore"):
        total = float(np.sum(values**2))
    return total if np.isfinite(total) else np.inf


def _damped_step(slopes: Array, residual: Array, damping: float) -> Array:
    """Return the step (k,) that minimises `residual` (rows,), plus `damping` times its own squares."""
    count = slopes.shape[1]
    rows = np.concatenate([slopes, np.sqrt(damping) * np.eye(count)])
    return np.asarray(np.linalg.lstsq(rows, np.concatenate([residual, np.zeros(count)]), rcond=_NEGLIGIBLE)[0])
