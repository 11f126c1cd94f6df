"""The derivative of a hypothesis with respect to its parameters: nuisances and effects.

Most of the cost is that with respect to the nuisances. With the torques of a simulation held it is linear and cheap;
that leaves out only how a moved mode changes what an effect does in turn. Such slopes decide nothing but the speed of a
descent, because every step is judged by the full simulation; so they are also kept for as long as they lead to where
they say. Where something strong acts in the modes themselves, that the effects answer is put in to first order.

To a small change that has nothing to do with a motion of many frequencies an effect answers, on average, like a gain:
in phase, a quarter of a turn behind at any frequency (a loop), and along the rate (a damper). For a force without
memory on a Gaussian motion it is also the gain that fits the force itself best (J. J. Bussgang, MIT RLE Report 216
(1952)), which is equivalent linearisation (T. K. Caughey, J. Acoust. Soc. Am. 35 (1963)). An effect in a mode makes
another mode of it; one between the channels is a feedback, closed frequency by frequency.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from analysis.diagnosis.candidates.signature import Motion, force_along, moved_as
from analysis.diagnosis.fitting.problem import Point, Problem, together
from analysis.diagnosis.nominal.responses import coasting, simulate
from analysis.diagnosis.nominal.tuning import Nuisance, sensitivities, turned, turning
from analysis.diagnosis.records.dataset import Record
from analysis.diagnosis.side_by_side import side_by_side
from sim_backend import kernel
from sim_backend.assembly import Places, retuned
from sim_backend.effects.base import Effect, Site
from sim_backend.intersample import steps_for
from sim_backend.linear import Array, ComplexArray, ModalModel, discretise, finer_for_delays
from sim_backend.modes import is_mode, mode_alone, mode_of
from sim_backend.wiring import effects_of

_STRAIGHT = 0.05
"""How far off what was said of it, in parts of its length, a step may end and only correct the columns."""

_STRAIGHT_SIMULATED, _SIMULATED = 0.3, 8
"""The same for simulated columns, each of which costs as much as a step; and so many of the nuisances' for every
step."""

_PASSES = 4
"""How often motion and gain of a mode follow each other: for a tenth of the stiffness that is right to 1e-4."""

_LEAST = 0.1
"""Part of a mode's stiffness and decay rate that no effect takes: beyond, the gain is a fault of the fit."""

_TOGETHER = 8
"""Columns that are transformed together."""

_SMALL, _SEED = 1e-3, 0
"""Size of the change that tells a gain, in units of the motion, and what draws its phases."""


class Slopes:
    """d(stacked)/dx of a hypothesis, as true as a descent has to have it.

    The nuisances' columns are those with torques held as long as these lead somewhere, then those of full simulations;
    beside a `strong` effect they are so from the start, as where those with torques held have `misled` before. A step
    that does nearly what was said of it corrects the columns along its own direction (Broyden 1965), and the next needs
    no simulations.

    Many modes that something strong acts in would make those slow: the columns then are those of effects that answer.
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
        self._fill_nuisances(columns[:, :n_nuisances], x, at)
        self._fill(columns, range(n_nuisances, x.size), x, at)
        return columns

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

    def _fill_nuisances(self, columns: Array, x: Array, at: Point) -> None:
        """Fill the nuisances' columns: with torques held, or from simulations for modes that an effect acts on."""
        problem, s = self._problem, self._problem.setting
        n_nuisances = len(s.nuisances)
        columns[:] = 0.0
        hard = self._hard()
        easy = [i for i in range(n_nuisances) if i not in hard]
        if easy:
            moved = self._moved(x, at, [s.nuisances[i] for i in easy])
            rows = at.stacked.size - x.size
            for i, column in zip(easy, problem.whiten(moved).reshape(rows, -1).T, strict=True):
                columns[:rows, i] = -column
            columns[rows:, easy] = problem.root[:, easy]
        self._fill(columns, hard, x, at)

    def _moved(self, x: Array, at: Point, nuisances: list[Nuisance]) -> list[Array]:
        """Return the outputs' changes per unit of `nuisances`, (n, n_y, k) per record, with no effect simulated."""
        s = self._problem.setting
        rate_hz, acting = s.data.rate_hz, [*s.known, *self._problem.effects(x)]
        linear = retuned(turned(s.nominal, s.nuisances, x[: len(s.nuisances)]), acting, s.places)

        # a delay that ends within a sample leaves no torque that is held; beside what acts on the way to the structure
        # the means over samples have to do
        on_the_way = any(e.site in (Site.COMMAND, Site.CURRENT, Site.DRIVE, Site.STRUCTURE) for e in acting)
        commanded = finer_for_delays(linear, rate_hz) > 1 and not on_the_way
        played = [r.u for r in s.data.records] if commanded else at.torques

        def answered(torque: Array, start: Array, record: Record, left: Array) -> Array:
            motion = moved_as(record, record.y - left, rate_hz)
            own = answering(linear, acting, s.places, motion, torque, start, rate_hz)
            return own.closed(sensitivities(own.linear, nuisances, own.torque, rate_hz, start, through_delay=False))

        if self._answering:
            return s.each(answered, at.torques, s.states, s.data.records, at.residuals)
        return s.each(turning(linear, nuisances, rate_hz, through_delay=commanded).columns, played, s.states)

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


@dataclass(frozen=True)
class Answering:
    """The linear model of one record, for sensitivities; it has the effects in its modes, `torque` (n, n_u) drives it.

    `closing` (n_y, n_y, n_f) is the closed loop (I − P F)⁻¹ over `length` samples: it takes changes of the outputs with
    the effects' forces frozen to changes with forces that react. None if no effect reacts, or a mode is free.
    """

    linear: ModalModel
    torque: Array
    closing: ComplexArray | None
    length: int

    def closed(self, moved: Array) -> Array:
        """Return changes of the outputs, (n, n_y, k), with what the effects do in turn."""
        if self.closing is None:
            return moved
        series = moved.T
        out = np.empty(series.shape)
        for first in range(0, series.shape[0], _TOGETHER):  # a few, for their spectra take twice their memory
            some = slice(first, first + _TOGETHER)
            held = scipy.fft.rfft(series[some], self.length)  # (k, n_y, n_f)
            closed = np.empty_like(held)
            for o, row in enumerate(self.closing):
                closed[:, o] = sum(weights * held[:, i] for i, weights in enumerate(row))
            out[some] = scipy.fft.irfft(closed, self.length)[..., : moved.shape[0]]
        return out.T


def answering(
    linear: ModalModel,
    effects: Sequence[Effect],
    places: Places,
    motion: Motion,
    torque: Array,
    start: Array,
    rate_hz: float,
) -> Answering:
    """Return `linear` in one record, moved from states `start` (m, 2) by `torque` (n, n_u) as it is at the samples."""
    acting = [e for e in effects if e.site in (Site.DRIVE, Site.STRUCTURE)]
    inside, outside = ([e for e in acting if is_mode(e.where) is so] for so in (True, False))
    told = [force_along(effect, places, motion, rate_hz) for effect in outside]
    forces = np.zeros_like(torque)
    for force, _, onto in told:
        forces += np.outer(force, onto)
    smooth = torque - forces + steps_for(forces)  # what depends on the motion changes between the samples, too
    omega, sigma = linear.omega_rad_s.copy(), linear.sigma_1_s.copy()
    for effect in inside:
        m = mode_of(linear, effect.where, effect.name)
        omega[m], sigma[m] = _mode_with(linear, m, effect, places, smooth, start[m : m + 1], rate_hz)
    own = linear.with_(omega_rad_s=omega, sigma_1_s=sigma)
    length = int(scipy.fft.next_fast_len(2 * motion.u.shape[0], real=True))
    fading = bool(np.all(linear.omega_rad_s * linear.sigma_1_s > 0.0))
    if not (outside and fading):
        return Answering(own, smooth, None, length)
    frequency_hz = scipy.fft.rfftfreq(length, 1.0 / rate_hz)
    back = np.zeros((frequency_hz.size, linear.n_inputs, linear.n_outputs), complex)
    for effect, (force, read, onto) in zip(outside, told, strict=True):
        gain = _gain(effect, places, motion, force, read, frequency_hz, rate_hz)
        back += np.outer(onto, read) * gain[:, None, None]
    return Answering(own, smooth, _closing(own, back, frequency_hz), length)


def _mode_with(
    linear: ModalModel, m: int, effect: Effect, places: Places, torque: Array, start: Array, rate_hz: float
) -> tuple[float, float]:
    """Return frequency (rad/s) and decay rate (1/s) of mode `m` with an effect in it.

    A force on a mode is measured by the deflection it holds at rest, so its gain in phase is a part of the stiffness.
    """
    alone = mode_alone(linear, m)
    fx, _ = effects_of([effect], places, linear)
    still, force = np.zeros((2, torque.shape[0]))
    omega, sigma = float(linear.omega_rad_s[m]), float(linear.sigma_1_s[m])
    own = omega, sigma
    for _ in range(_PASSES):
        model = discretise(alone.with_(omega_rad_s=np.array([own[0]]), sigma_1_s=np.array([own[1]])), rate_hz)
        moved = simulate(model, torque, through_delay=False) + coasting(model, start, torque.shape[0])
        x, v = np.ascontiguousarray(moved.T)
        kernel.contribution_along(fx, 0, still, x, v, still, 1.0 / rate_hz, force)
        in_phase, along_rate = np.linalg.lstsq(np.stack([x, v / omega], axis=1), force, rcond=None)[0]
        stiffness = max(1.0 - float(in_phase), _LEAST)
        own = float(omega * np.sqrt(stiffness)), max(sigma - 0.5 * omega * float(along_rate), _LEAST * sigma)
    return own


def _closing(linear: ModalModel, forces: ComplexArray, frequency_hz: Array) -> ComplexArray:
    """Return (1 - P F)⁻¹ at every frequency: the outputs make `forces` F (n_f, n_u, n_y), which the plant P answers."""
    plant = linear.with_(delay_s=np.zeros(linear.n_inputs)).frequency_response(frequency_hz)
    closing = np.linalg.inv(np.eye(linear.n_outputs) - plant @ forces)
    return np.ascontiguousarray(closing.transpose(1, 2, 0))


def _gain(
    effect: Effect, places: Places, motion: Motion, force: Array, row: Array, frequency_hz: Array, rate_hz: float
) -> ComplexArray:
    """Return the gain (n_f,) from a small change of the motion along `row` (n_y,) to that of an effect's `force` (n,).

    The change has the spectrum of the motion and phases of its own.
    """
    x = motion.position @ row
    n, phases = x.size, np.random.default_rng(_SEED).random(x.size // 2 + 1)
    spectrum = scipy.fft.rfft(x - x.mean()) * np.exp(2j * np.pi * phases)
    turning = 2j * np.pi * scipy.fft.rfftfreq(n, 1.0 / rate_hz)
    columns = np.stack([scipy.fft.irfft(part * spectrum, n) for part in (1.0, -1j, turning)], axis=1)
    along = _SMALL * row / float(row @ row)
    nearby = replace(
        motion,
        position=motion.position + np.outer(columns[:, 0], along),
        rate=motion.rate + np.outer(columns[:, 2], along),
    )
    change = force_along(effect, places, nearby, rate_hz)[0] - force
    scale = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    in_phase, behind, along_rate = np.linalg.lstsq(columns / scale, change / _SMALL, rcond=None)[0] / scale
    lag = np.where(frequency_hz > 0.0, -1j, 0.0)
    return np.asarray(in_phase + lag * behind + 2j * np.pi * frequency_hz * along_rate)
