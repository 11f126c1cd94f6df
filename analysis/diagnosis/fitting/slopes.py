"""The derivative of a hypothesis with respect to its parameters: knobs and effects.

Most of the cost is that with respect to the knobs. With the torques of a simulation held it is linear and cheap; that
leaves out only how a moved mode changes what an effect does in turn. Such slopes decide nothing but the speed of a
descent, because every step is judged by the full simulation; so they are also kept for as long as they lead to where
they say. Where something strong acts in the modes themselves, that the effects answer is put in to first order.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.candidates.motions import moved_as
from analysis.diagnosis.fitting.feedback import answering
from analysis.diagnosis.fitting.problem import Point, Problem
from analysis.diagnosis.nominal.tuning import Knob, sensitivities, turned
from analysis.diagnosis.records.dataset import Record
from sim_backend.assembly import retuned
from sim_backend.effects.base import Site
from sim_backend.linear import finer_for_delays
from sim_backend.modes import is_mode

Array = NDArray[np.float64]

_STRONG_STEPS = 2
"""Steps for which the knobs' columns serve beside a strong effect: computing them costs more than a step."""

_STRAIGHT = 0.05
"""A step that ends this much of its own length off what columns with torques held said of it has them renewed."""


class Slopes:
    """d(stacked)/dx of a hypothesis, the knobs' columns with torques held or, `exact`, from full simulations.

    `approximate` tells whether it makes a difference. Exact knob columns are computed once and kept for the small steps
    that are left; beside a `strong` effect, where steps still are large, they are renewed every other step. Many modes
    that something strong acts in would make that slow: the columns then are those of effects that answer, every time.
    """

    def __init__(self, problem: Problem, *, exact: bool, strong: bool = False) -> None:
        # columns are computed side by side already; each simulation need not be
        self._problem = replace(problem, setting=replace(problem.setting, workers=1)) if exact else problem
        self._answering = strong and any(is_mode(c.where) for c in problem.candidates)
        self._workers, self._exact, self._strong, self._age = problem.setting.workers, exact, strong, 0
        sites = [e.site for e in problem.setting.known] + [c.effect.site for c in problem.candidates]
        late = any(knob.field == "delay_s" for knob in problem.setting.knobs)
        self.approximate = late or any(site not in (Site.COMMAND, Site.CURRENT, Site.MODEL) for site in sites)
        self._last: tuple[Array, Array, Array] | None = None

    def normal(self, x: Array, at: Point) -> tuple[Array, Array]:
        """Return the normal equations at `x`."""
        jacobian = self._at(x, at)
        self._last = x, at.stacked, jacobian
        return jacobian.T @ jacobian, -jacobian.T @ at.stacked

    def latest(self, x: Array, at: Point) -> Array:
        """Return the columns at the last place where a step began."""
        return self._at(x, at) if self._last is None else self._last[2]

    def _at(self, x: Array, at: Point) -> Array:
        n_knobs = len(self._problem.setting.knobs)
        columns = np.empty((x.size, at.stacked.size)).T  # a column is one stretch of memory, as it is computed
        kept = self._serving(x, at)
        columns[:, :n_knobs] = self._knobs(x, at) if kept is None else kept[:, :n_knobs]
        self._age += 1
        own = range(n_knobs, x.size)
        with ThreadPoolExecutor(self._workers) as pool:
            for i, column in zip(own, pool.map(lambda i: self._slope(x, at, i), own), strict=True):
                columns[:, i] = column
        return columns

    def _serving(self, x: Array, at: Point) -> Array | None:
        """Return the last columns if those of the knobs serve at `x` as well."""
        if self._last is None:
            return None
        before, there, jacobian = self._last
        if self._exact:
            outworn = self._answering or (self._strong and self._age % _STRONG_STEPS == 0)
        else:
            told = jacobian @ (x - before)
            outworn = bool(np.sum((at.stacked - there - told) ** 2) > _STRAIGHT**2 * np.sum(told**2))
        return None if outworn else jacobian

    def _knobs(self, x: Array, at: Point) -> Array:
        """Return the knobs' columns: with torques held, or from simulations for modes that an effect acts on."""
        problem, s = self._problem, self._problem.setting
        n_knobs = len(s.knobs)
        columns = np.zeros((n_knobs, at.stacked.size)).T
        exact = self._exact and self.approximate and not self._answering
        hard = [i for i in range(n_knobs) if exact and self._touched(s.knobs[i])]
        easy = [i for i in range(n_knobs) if i not in hard]
        if easy:
            moved = self._moved(x, at, [s.knobs[i] for i in easy])
            rows = at.stacked.size - x.size
            for i, column in zip(easy, problem.whiten(moved).reshape(rows, -1).T, strict=True):
                columns[:rows, i] = -column
            columns[rows:, easy] = problem.root[:, easy]
        with ThreadPoolExecutor(self._workers) as pool:
            for i, column in zip(hard, pool.map(lambda i: self._slope(x, at, i), hard), strict=True):
                columns[:, i] = column
        return columns

    def _moved(self, x: Array, at: Point, knobs: list[Knob]) -> list[Array]:
        """Return the outputs' changes per unit of `knobs`, (n, n_y, k) per record, without simulating the effects."""
        s = self._problem.setting
        rate_hz, acting = s.data.rate_hz, [*s.known, *self._problem.effects(x)]
        linear = retuned(turned(s.nominal, s.knobs, x[: len(s.knobs)]), acting, s.places)

        # a delay that ends within a sample leaves no torque that is held; beside what acts on the way to the structure
        # the means over samples have to do
        on_the_way = any(e.site in (Site.COMMAND, Site.CURRENT, Site.DRIVE, Site.STRUCTURE) for e in acting)
        commanded = finer_for_delays(linear, rate_hz) > 1 and not on_the_way
        played = [r.u for r in s.data.records] if commanded else at.torques

        def held(torque: Array, start: Array) -> Array:
            return sensitivities(linear, knobs, torque, rate_hz, start, through_delay=commanded)

        def answered(torque: Array, start: Array, record: Record, left: Array) -> Array:
            motion = moved_as(record, record.y - left, rate_hz)
            own = answering(linear, acting, s.places, motion, torque, start, rate_hz)
            return own.closed(sensitivities(own.linear, knobs, own.torque, rate_hz, start, through_delay=False))

        if self._answering:
            return s.each(answered, at.torques, s.states, s.data.records, at.residuals)
        return s.each(held, played, s.states)

    def _slope(self, x: Array, at: Point, i: int) -> Array:
        """Return d(stacked)/dx_i by a difference of full simulations; zero where there is no model on either side."""
        problem = self._problem
        column, rows = np.zeros(at.stacked.size), at.stacked.size - x.size
        found = problem.slope(x, i, at.residuals)
        if found is not None:
            column[:rows] = problem.whiten(found)
            column[rows:] = problem.root[:, i]
        return column

    def _touched(self, knob: Knob) -> bool:
        """Tell whether an effect acts on, or through, the mode of this knob."""
        s = self._problem.setting
        if knob.mode < 0:
            return knob.field == "delay_s"  # torques held, what an effect adds at an input would be late as well
        inputs = {s.places.inputs[j] for j in range(s.nominal.n_inputs) if s.nominal.b[knob.mode, j] != 0.0}
        outputs = {s.places.outputs[o] for o in range(s.nominal.n_outputs) if s.nominal.c[o, knob.mode] != 0.0}
        acting = [c.where for c in self._problem.candidates] + [e.where for e in s.known]
        names = {name for where in acting for name in where.split("->")}
        return bool(names & (inputs | outputs)) or not names <= {*s.places.inputs, *s.places.outputs}
