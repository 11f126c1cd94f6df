"""The hidden bench: a simulator of the challenge's own, on a grid eight times finer than the samples.

It shares no code with the bench that a diagnosis fits: modes are stepped exactly (their closed form), torques that
depend on the motion are taken in the middle of each fine step from a half step ahead, which makes it of second order in
the fine step. Commands, external torques and readings are whole arrays, which each effect changes in turn.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.challenge.families.base import Hidden
from analysis.challenge.laws import MEMORY, advance
from analysis.challenge.motion import Excitation, Motion
from analysis.challenge.plant import Plant

Array = NDArray[np.float64]


def exact_step(plant: Plant, dt_s: float) -> tuple[Array, Array]:
    """Return each mode's closed-form transition (m, 2, 2) over `dt_s` and its response (m, 2) to a held unit force."""
    omega, sigma = plant.omega_rad_s, plant.sigma_1_s
    damped = np.sqrt((omega**2 - sigma**2).astype(complex))
    decay = np.exp(-sigma * dt_s)
    cos = (decay * np.cos(damped * dt_s)).real
    sin = (decay * np.sin(damped * dt_s) / damped).real
    step = np.empty((omega.size, 2, 2))
    step[:, 0, 0], step[:, 0, 1] = cos + sigma * sin, sin
    step[:, 1, 0], step[:, 1, 1] = -(omega**2) * sin, cos - sigma * sin
    push = np.stack([(1.0 - cos - sigma * sin) / omega**2, sin], axis=1)
    return step, push


def move(
    plant: Plant, hidden: Sequence[Hidden], excitation: Excitation, start: Array, rng: np.random.Generator
) -> Motion:
    """Return the true motion under `hidden` effects from modal states `start` (modes, 2) of the case's plant."""
    for effect in hidden:
        plant = effect.on_plant(plant)
    drive = excitation.fine(excitation.command)
    for effect in hidden:
        drive = effect.on_command(drive, excitation)
    drive = _delayed(drive, plant.delay_s / excitation.fine_s)
    for effect in hidden:
        drive = effect.on_torque(drive, excitation, rng)
    laws = [effect.law() for effect in hidden]
    found = [law for law in laws if law is not None]
    parameters, memory = np.zeros((len(found), 8)), np.zeros((len(found), MEMORY))
    for i, law in enumerate(found):
        parameters[i, : len(law.parameters)] = law.parameters
    q = np.zeros((plant.n_modes, 2))
    q[: start.shape[0]] = start
    position, rate = np.empty_like(drive), np.empty_like(drive)
    dt_s = excitation.fine_s
    advance(
        exact_step(plant, dt_s),
        exact_step(plant, 0.5 * dt_s),
        plant.b,
        plant.c,
        drive,
        excitation.fine(excitation.temperature_k - excitation.reference_k),
        np.array([law.code for law in found], dtype=np.int64),
        np.array([law.axis for law in found], dtype=np.int64),
        parameters,
        memory,
        dt_s,
        q,
        position,
        rate,
    )
    return Motion(position, rate, excitation.substeps)


def read(
    motion: Motion, hidden: Sequence[Hidden], excitation: Excitation, noise: Array, rng: np.random.Generator
) -> Array:
    """Return the readings (n, axes): the motion, the sensors' effects, `noise` (n, axes), the recorder's effects."""
    reading = motion.sampled()
    for effect in hidden:
        reading = effect.on_reading(reading, motion, excitation, rng)
    reading = reading + noise
    for effect in hidden:
        reading = effect.on_record(reading, rng)
    return reading


def _delayed(drive: Array, steps: Array) -> Array:
    """Return `drive` later by `steps` (axes,) fine steps; a part of a step shares it between two, as its mean does."""
    out = np.empty_like(drive)
    for a, late in enumerate(steps):
        whole, part = int(late), float(late) % 1.0
        padded = np.concatenate([np.zeros(whole + 1), drive[:, a]])
        out[:, a] = (1.0 - part) * padded[1 : drive.shape[0] + 1] + part * padded[: drive.shape[0]]
    return out
