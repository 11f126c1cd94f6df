"""The derivative of a hypothesis with respect to its parameters: knobs and effects.

Most of the cost is that with respect to the knobs. With the torques of a simulation held it is linear and cheap; that
leaves out only how a moved mode changes what an effect does in turn. Such slopes decide nothing but the speed of a
descent, because every step is judged by the full simulation; so they are also kept for as long as they lead to where
they say. Where something strong acts in the modes themselves, that the effects answer is put in to first order.
"""

from __future__ import annotations

from collections.abc import Sequence
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

_STRAIGHT = 0.05
"""How far off what was said of it, in parts of its length, a step may end and only correct the columns."""

_STRAIGHT_SIMULATED, _SIMULATED = 0.3, 8
"""The same for simulated columns, each of which costs as much as a step; and so many of the knobs' for every step."""


class Slopes:
    """d(stacked)/dx of a hypothesis, as true as a descent has to have it.

    The knobs' columns are those with torques held as long as these lead somewhere, then those of full simulations;
    beside a `strong` effect they are so from the start, as where those with torques held have `misled` before. A step
    that does nearly what was said of it corrects the columns along its own direction (Broyden 1965), and the next needs
    no simulations.

    Many modes that something strong acts in would make those slow: the columns then are those of effects that answer.
    """

    def __init__(self, problem: Problem, *, strong: bool = False, misled: bool = False) -> None:
        self._problem = problem
        # columns are computed side by side already; each simulation need not be
        self._alone = replace(problem, setting=replace(problem.setting, workers=1))
        self._answering = strong and any(is_mode(c.where) for c in problem.candidates)
        sites = [e.site for e in problem.setting.known] + [c.effect.site for c in problem.candidates]
        late = any(knob.field == "delay_s" for knob in problem.setting.knobs)
        approximate = late or any(site not in (Site.COMMAND, Site.CURRENT, Site.MODEL) for site in sites)
        self._may_simulate = approximate and not self._answering
        self._simulated = (strong or misled) and self._may_simulate
        self.misled = misled
        self._last: tuple[Array, Array, Array] | None = None
        self._outworn, self._own, self._age = False, False, 0

    def normal(self, x: Array, at: Point) -> tuple[Array, Array]:
        """Return the normal equations at `x`."""
        kept = None if self._outworn else self._corrected(x, at)
        self._own, self._outworn = kept is None, False
        self._age = 0 if kept is None else self._age + 1
        self._last = x, at.stacked, self._at(x, at) if kept is None else kept
        jacobian = self._last[2]
        return jacobian.T @ jacobian, -jacobian.T @ at.stacked

    def fresh(self) -> bool:
        """Tell whether the last columns were of the place itself; if not, the next ones will be."""
        self._outworn |= not self._own
        return self._own

    def truer(self) -> bool:
        """Tell whether there are truer columns, which is what is asked for from then on."""
        if self._simulated or not self._may_simulate:
            return False
        self._simulated = self._outworn = True
        return True

    def failed(self) -> bool:
        """Tell whether there are truer columns than these, which have led astray."""
        self.misled |= not self._simulated and self._may_simulate
        return self.truer()

    def latest(self, x: Array, at: Point) -> Array:
        """Return the columns at the last place where a step began."""
        return self._at(x, at) if self._last is None else self._last[2]

    def _corrected(self, x: Array, at: Point) -> Array | None:
        """Return the last columns, so that they say what the step from there did; None where others are to be had.

        Where a step ended far off what was said of it, those of the effects, which are few, are had anew.
        """
        if self._last is None or self._answering:
            return None
        before, there, jacobian = self._last
        told = jacobian @ (x - before)
        missed = at.stacked - there - told
        straight = _STRAIGHT_SIMULATED if self._simulated else _STRAIGHT
        astray = not np.sum(missed**2) <= straight**2 * np.sum(told**2)
        if astray and not (self._simulated and _SIMULATED * self._age < len(self._hard())):
            return None
        weights = np.einsum("ij,ij->j", jacobian, jacobian) * (x - before)  # no unit of a parameter counts
        length = float(weights @ (x - before))
        corrected = jacobian + np.outer(missed, weights / length) if length > 0.0 else jacobian.copy()
        if astray:
            self._fill(corrected, range(len(self._problem.setting.knobs), x.size), x, at)
        return corrected

    def _hard(self) -> list[int]:
        """Return the numbers of the knobs whose columns are simulated, those of modes that an effect acts on."""
        knobs = self._problem.setting.knobs
        return [i for i, knob in enumerate(knobs) if self._simulated and self._touched(knob)]

    def _at(self, x: Array, at: Point) -> Array:
        n_knobs = len(self._problem.setting.knobs)
        columns = np.empty((x.size, at.stacked.size)).T  # a column is one stretch of memory, as it is computed
        columns[:, :n_knobs] = self._knobs(x, at)
        self._fill(columns, range(n_knobs, x.size), x, at)
        return columns

    def _fill(self, columns: Array, which: Sequence[int], x: Array, at: Point) -> None:
        with ThreadPoolExecutor(self._problem.setting.workers) as pool:
            for i, column in zip(which, pool.map(lambda i: self._slope(x, at, i), which), strict=True):
                columns[:, i] = column

    def _knobs(self, x: Array, at: Point) -> Array:
        """Return the knobs' columns: with torques held, or from simulations for modes that an effect acts on."""
        problem, s = self._problem, self._problem.setting
        n_knobs = len(s.knobs)
        columns = np.zeros((n_knobs, at.stacked.size)).T
        hard = self._hard()
        easy = [i for i in range(n_knobs) if i not in hard]
        if easy:
            moved = self._moved(x, at, [s.knobs[i] for i in easy])
            rows = at.stacked.size - x.size
            for i, column in zip(easy, problem.whiten(moved).reshape(rows, -1).T, strict=True):
                columns[:rows, i] = -column
            columns[rows:, easy] = problem.root[:, easy]
        self._fill(columns, hard, x, at)
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
        problem = self._alone
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
