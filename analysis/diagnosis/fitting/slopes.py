"""The derivative of a hypothesis with respect to its parameters: nuisances and effects.

Most of the cost is that with respect to the nuisances. With the torques of a simulation held it is linear and cheap;
that leaves out only how a moved mode changes what an effect does in turn. Such slopes decide nothing but the speed of a
descent, because every step is judged by the full simulation; so they are also kept for as long as they lead to where
they say. Where something strong acts in the modes themselves, that the effects answer is put in to first order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.candidates.signature import moved_as
from analysis.diagnosis.fitting.answering import answering
from analysis.diagnosis.fitting.problem import Point, Problem, together
from analysis.diagnosis.nominal.tuning import Nuisance, sensitivities, turned, turning
from analysis.diagnosis.records.dataset import Record
from analysis.diagnosis.side_by_side import side_by_side
from sim_backend.assembly import retuned
from sim_backend.effects.base import Site
from sim_backend.linear import Array, late_within_samples
from sim_backend.modes import is_mode

_STRAIGHT = 0.05
"""How far off what was said of it, in parts of its length, a step may end and only correct the columns."""

_STRAIGHT_SIMULATED, _SIMULATED = 0.3, 8
"""The same for simulated columns, each of which costs as much as a step; and so many of the nuisances' for every
step."""


class Slopes:
    """d(stacked)/dx of a hypothesis, as true as a descent has to have it.

    The nuisances' columns are those with torques held as long as these lead somewhere, then those of full simulations;
    beside a `strong` effect they are so from the start, as where those with torques held have `misled` before. A step
    that does nearly what was said of it corrects the columns along its own direction (Broyden 1965), and the next needs
    no simulations.

    Many modes that something strong acts in would make those slow: the columns of nuisances, and of what acts in modes,
    then are those of effects that answer (`analysis.diagnosis.fitting.answering`).
    """

    def __init__(self, problem: Problem, *, strong: bool = False, misled: bool = False) -> None:
        self._problem = problem
        # columns are computed side by side already; the records of each need not be
        self._alone = replace(problem, setting=replace(problem.setting, workers=1))
        self._answering = strong and any(is_mode(c.where) for c in problem.candidates)
        sites = [e.site for e in problem.setting.known] + [c.effect.site for c in problem.candidates]
        late = any(nuisance.field == "delay_s" for nuisance in problem.setting.nuisances)
        approximate = late or any(site not in (Site.COMMAND, Site.CURRENT, Site.MODEL) for site in sites)
        self._may_simulate = approximate and not self._answering
        self._simulated = (strong or misled) and self._may_simulate
        self.misled = misled
        self._last: tuple[Array, Array, Array] | None = None
        self._outworn, self._own, self._age = False, False, 0

    def normal(self, x: Array, at: Point) -> tuple[Array, Array]:
        """Return the normal equations at `x` (n,): H (n, n) and -gradient/2 (n,)."""
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
        """Return the columns (rows + n, n) at the last place where a step began."""
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
        if length > 0.0:
            # in place: of a long record the columns are hundreds of megabytes, which the system would fill with zeros
            for column, weight in zip(jacobian.T, weights / length, strict=True):
                column += missed * weight
        if astray:
            self._fill(jacobian, range(len(self._problem.setting.nuisances), x.size), x, at)
        return jacobian

    def _hard(self) -> list[int]:
        """Return the numbers of the nuisances whose columns are simulated, those of modes that an effect acts on."""
        nuisances = self._problem.setting.nuisances
        return [i for i, nuisance in enumerate(nuisances) if self._simulated and self._touched(nuisance)]

    def _at(self, x: Array, at: Point) -> Array:
        n_nuisances = len(self._problem.setting.nuisances)
        columns = np.empty((x.size, at.stacked.size)).T  # a column is one stretch of memory, as it is computed
        inside = self._inside()
        self._fill_linear(columns, inside, x, at)
        self._fill(columns, [i for i in range(n_nuisances, x.size) if i not in inside], x, at)
        return columns

    def _inside(self) -> dict[int, int]:
        """Return the numbers of parameters of effects in modes, and whose they are, where effects answer."""
        problem, first = self._problem, len(self._problem.setting.nuisances)
        in_mode = [self._answering and is_mode(c.where) for c in problem.candidates]
        return {first + k: scale.effect for k, scale in enumerate(problem.scales) if in_mode[scale.effect]}

    def _fill(self, columns: Array, which: Sequence[int], x: Array, at: Point) -> None:
        """Fill columns by differences of full simulations; with zeros where there is no model on either side."""
        rows = at.stacked.size - x.size

        def fill(several: Sequence[int]) -> None:
            for i, found in zip(several, self._alone.slopes(x, several, at.residuals), strict=True):
                columns[:, i] = 0.0
                if found is not None:
                    columns[:rows, i] = self._alone.whiten(found)
                    columns[rows:, i] = self._problem.root[:, i]

        for _ in side_by_side(fill, together(which), workers=self._problem.setting.workers):
            pass

    def _fill_linear(self, columns: Array, inside: Mapping[int, int], x: Array, at: Point) -> None:
        """Fill the columns of nuisances, and of parameters `inside` modes.

        With torques held, or from simulations for nuisances of modes that an effect acts on.
        """
        problem, s = self._problem, self._problem.setting
        hard = self._hard()
        easy = [i for i in range(len(s.nuisances)) if i not in hard]
        linear = [*easy, *inside]
        if linear:
            moved = self._moved(x, at, [s.nuisances[i] for i in easy], inside)
            rows = at.stacked.size - x.size
            for i, column in zip(linear, problem.whiten(moved).reshape(rows, -1).T, strict=True):
                columns[:rows, i] = -column
            columns[rows:, linear] = problem.root[:, linear]
        self._fill(columns, hard, x, at)

    def _moved(self, x: Array, at: Point, nuisances: list[Nuisance], inside: Mapping[int, int]) -> list[Array]:
        """Return the outputs' changes per unit of `nuisances` and of parameters `inside` modes, (n, n_y, k) per record.

        No effect is simulated.
        """
        s = self._problem.setting
        nearby = [(which, *self._problem.near(x, i)) for i, which in inside.items()]
        effects = self._problem.effects(x)
        rate_hz, acting = s.data.rate_hz, [*s.known, *effects]
        linear = retuned(turned(s.nominal, s.nuisances, x[: len(s.nuisances)]), acting, s.places)

        # a delay that ends within a sample leaves no torque that is held; beside what acts on the way to the structure
        # the means over samples have to do
        sites = {effect.site for effect in acting}
        in_drive = bool(sites & {Site.COMMAND, Site.CURRENT, Site.DRIVE})
        commanded = late_within_samples(linear, rate_hz) and not in_drive and Site.STRUCTURE not in sites
        # commands alone are late: what acts on the structure is not
        late = [] if in_drive else [i for i, nuisance in enumerate(nuisances) if nuisance.field == "delay_s"]
        delays = turning(linear, [nuisances[i] for i in late], rate_hz)

        def with_delays(moved: Array, record: Record, start: Array) -> Array:
            if late:
                moved[:, :, late] = delays.columns(record.u, start)
            return moved

        def answered(torque: Array, start: Array, record: Record, left: Array) -> Array:
            motion = moved_as(record, record.y - left, rate_hz)
            own = answering(linear, acting, s.places, motion, torque, start, rate_hz)
            moved = sensitivities(own.linear, nuisances, own.torque, rate_hz, start, through_delay=False)
            moved = with_delays(moved, record, start)
            pushed = [own.moved_by(effects[which], there, s.places, rate_hz) / step for which, there, step in nearby]
            return own.closed(np.concatenate([moved, *(p[:, :, None] for p in pushed)], axis=2))

        if self._answering:
            return s.each(answered, at.torques, s.states, s.data.records, at.residuals)
        whole = turning(linear, nuisances, rate_hz, through_delay=commanded)
        if commanded:  # these hold the delays' columns as well
            return s.each(whole.columns, [r.u for r in s.data.records], s.states)

        def columns(torque: Array, start: Array, record: Record) -> Array:
            return with_delays(whole.columns(torque, start), record, start)

        return s.each(columns, at.torques, s.states, s.data.records)

    def _touched(self, nuisance: Nuisance) -> bool:
        """Tell whether an effect acts on, or through, the mode of this nuisance."""
        s = self._problem.setting
        if nuisance.mode < 0:
            return nuisance.field == "delay_s"  # torques held, what an effect adds at an input would be late as well
        inputs = {s.places.inputs[j] for j in range(s.nominal.n_inputs) if s.nominal.b[nuisance.mode, j] != 0.0}
        outputs = {s.places.outputs[o] for o in range(s.nominal.n_outputs) if s.nominal.c[o, nuisance.mode] != 0.0}
        acting = [c.where for c in self._problem.candidates] + [e.where for e in s.known]
        names = {name for where in acting for name in where.split("->")}
        return bool(names & (inputs | outputs)) or not names <= {*s.places.inputs, *s.places.outputs}
