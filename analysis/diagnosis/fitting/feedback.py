"""What effects do in turn when a motion changes: their gains, closed around the linear model.

With the torques of a simulation held, a knob's change of the motion is linear and cheap, but an effect that answers to
the motion answers to its change as well. To a small change that has nothing to do with a motion of many frequencies an
effect answers, on average, like a gain: in phase, a quarter of a turn behind at any frequency (a loop), and along the
rate (a damper). For a force without memory on a Gaussian motion it is also the gain that fits the force itself best
(J. J. Bussgang, MIT RLE Report 216 (1952)), which is equivalent linearisation (T. K. Caughey, J. Acoust. Soc. Am. 35
(1963)). An effect in a mode makes another mode of it; one between the channels is a feedback, closed frequency by
frequency.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.diagnosis.candidates.signature import Motion, force_along
from analysis.diagnosis.nominal.responses import coasting, simulate
from sim_backend import kernel
from sim_backend.assembly import Places
from sim_backend.effects.base import Effect, Site
from sim_backend.intersample import steps_for
from sim_backend.linear import ModalModel, discretise
from sim_backend.modes import is_mode, mode_alone, mode_of
from sim_backend.wiring import effects_of

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_PASSES = 4
"""How often motion and gain of a mode follow each other: for a tenth of the stiffness that is right to 1e-4."""

_LEAST = 0.1
"""Part of a mode's stiffness and decay rate that no effect takes: beyond, the gain is a fault of the fit."""

_SMALL, _SEED = 1e-3, 0
"""Size of the change that tells a gain, in units of the motion, and what draws its phases."""


@dataclass(frozen=True)
class Answering:
    """One record's linear model with what acts in its modes, and torques (n, n_u), held for a sample each, on it.

    `closing` (n_y, n_y, n_f) takes changes of the outputs, transformed over `length` rows, from torques held to torques
    that answer; there is none where none answers, or where the model never comes to rest.
    """

    linear: ModalModel
    torque: Array
    closing: ComplexArray | None
    length: int

    def closed(self, moved: Array) -> Array:
        """Return changes of the outputs, (n, n_y, k), with what the effects do in turn."""
        if self.closing is None:
            return moved
        held = scipy.fft.rfft(moved.T, self.length)  # (k, n_y, n_f)
        out = np.empty_like(held)
        for o, row in enumerate(self.closing):
            out[:, o] = sum(weights * held[:, i] for i, weights in enumerate(row))
        return np.asarray(scipy.fft.irfft(out, self.length)[..., : moved.shape[0]].T)


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
