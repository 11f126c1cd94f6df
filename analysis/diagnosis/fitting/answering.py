"""What effects do in turn when the motion changes, to first order.

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

from analysis.diagnosis.candidates.signature import Motion, force_along
from analysis.diagnosis.nominal.responses import coasting, simulate
from sim_backend import kernel, layout
from sim_backend.assembly import Places
from sim_backend.effects.base import Effect, Site
from sim_backend.intersample import steps_for
from sim_backend.linear import Array, ComplexArray, ModalModel, discretise
from sim_backend.modes import is_mode, mode_alone, mode_of, reach_of
from sim_backend.wiring import effects_of

_PASSES = 4
"""How often motion and gain of a mode follow each other: for a tenth of the stiffness that is right to 1e-4."""

_LEAST = 0.1
"""Part of a mode's stiffness and decay rate that no effect takes: beyond, the gain is a fault of the fit."""

_TOGETHER = 8
"""Columns that are transformed together."""

_SMALL, _SEED = 1e-3, 0
"""Size of the change that tells a gain, in units of the motion, and what draws its phases."""


@dataclass(frozen=True)
class Answering:
    """The linear model of one record, for sensitivities; it has the effects in its modes, `torque` (n, n_u) drives it.

    `plain` is the model without them, `motions` (2, n) what deflection and rate of each mode with an effect are, by its
    number. `closing` (n_y, n_y, n_f) is the closed loop (I − P F)⁻¹ over `length` samples: it takes changes of the
    outputs with the effects' forces frozen to changes with forces that react. None if no effect reacts, or a mode is
    free.
    """

    linear: ModalModel
    plain: ModalModel
    motions: dict[int, Array]
    torque: Array
    closing: ComplexArray | None
    length: int

    def moved_by(self, before: Effect, after: Effect, places: Places, rate_hz: float) -> Array:
        """Return the change (n, n_y) of the outputs when an effect in a mode becomes another one, all others frozen.

        Its force changes along the motion as it is, and the mode answers as the effect lets it.
        """
        m = mode_of(self.plain, before.where, before.name)
        arrays = [effects_of([effect], places, self.plain)[0] for effect in (before, after)]
        forces = [_force_along(fx, self.motions[m], rate_hz) for fx in arrays]
        push = self.plain.omega_rad_s[m] ** 2 / reach_of(self.plain, m)  # a force counts by the deflection at rest
        pushed = self.linear.driven_by([0]).only(np.arange(self.linear.n_blocks) == m)
        pushed = pushed.with_(
            b=np.array([[push]]), b_direct=np.zeros((1, 1)), d=np.zeros_like(pushed.d), delay_s=np.zeros(1)
        )
        change = steps_for((forces[1] - forces[0])[:, None])
        return simulate(discretise(pushed, rate_hz), change, through_delay=False)

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
    omega, sigma, motions = linear.omega_rad_s.copy(), linear.sigma_1_s.copy(), {}
    for effect in inside:
        m = mode_of(linear, effect.where, effect.name)
        (omega[m], sigma[m]), motions[m] = _mode_with(linear, m, effect, places, smooth, start[m : m + 1], rate_hz)
    own = linear.with_(omega_rad_s=omega, sigma_1_s=sigma)
    length = int(scipy.fft.next_fast_len(2 * motion.u.shape[0], real=True))
    fading = bool(np.all(linear.omega_rad_s * linear.sigma_1_s > 0.0))
    if not (outside and fading):
        return Answering(own, linear, motions, smooth, None, length)
    frequency_hz = scipy.fft.rfftfreq(length, 1.0 / rate_hz)
    back = np.zeros((frequency_hz.size, linear.n_inputs, linear.n_outputs), complex)
    for effect, (force, read, onto) in zip(outside, told, strict=True):
        gain = _gain(effect, places, motion, force, read, frequency_hz, rate_hz)
        back += np.outer(onto, read) * gain[:, None, None]
    return Answering(own, linear, motions, smooth, _closing(own, back, frequency_hz), length)


def _mode_with(
    linear: ModalModel, m: int, effect: Effect, places: Places, torque: Array, start: Array, rate_hz: float
) -> tuple[tuple[float, float], Array]:
    """Return frequency (rad/s) and decay rate (1/s) of mode `m` with an effect in it, and deflection and rate (2, n).

    A force on a mode is measured by the deflection it holds at rest, so its gain in phase is a part of the stiffness.
    """
    alone, fx = mode_alone(linear, m), effects_of([effect], places, linear)[0]
    omega, sigma = float(linear.omega_rad_s[m]), float(linear.sigma_1_s[m])
    own, motion = (omega, sigma), np.zeros((2, torque.shape[0]))
    for _ in range(_PASSES):
        model = discretise(alone.with_(omega_rad_s=np.array([own[0]]), sigma_1_s=np.array([own[1]])), rate_hz)
        moved = simulate(model, torque, through_delay=False) + coasting(model, start, torque.shape[0])
        motion = np.ascontiguousarray(moved.T)
        force = _force_along(fx, motion, rate_hz)  # what it remembers at the end it begins the next pass with
        in_phase, along_rate = _along(motion[0], motion[1] / omega, force)
        stiffness = max(1.0 - in_phase, _LEAST)
        own = float(omega * np.sqrt(stiffness)), max(sigma - 0.5 * omega * along_rate, _LEAST * sigma)
    return own, motion


def _force_along(fx: layout.Effects, motion: Array, rate_hz: float) -> Array:
    """Return the force (n,) of an effect in a mode that moves by a deflection with its rate, (2, n)."""
    still, force = np.zeros((2, motion.shape[1]))
    kernel.contribution_along(fx, 0, still, motion[0], motion[1], still, 1.0 / rate_hz, force)
    return force


def _along(first: Array, second: Array, force: Array) -> tuple[float, float]:
    """Return the parts of two motions (n,) in a force (n,), by least squares."""
    basis = np.stack([first, second])
    gram, right = basis @ basis.T, basis @ force
    found = np.linalg.lstsq(gram, right, rcond=None)[0]
    return float(found[0]), float(found[1])


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
