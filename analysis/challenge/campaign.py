"""One hidden campaign before any effect is in it: plant, runs, noises, starts; and what it measures with effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.challenge.bench import move, read
from analysis.challenge.experiment import RATE_HZ, Run, draw_runs
from analysis.challenge.families import Hidden, Scene
from analysis.challenge.motion import Motion
from analysis.challenge.noise import Noise, draw_noise
from analysis.challenge.plant import Plant, draw_plant

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Campaign:
    """A bench and what is played on it.

    `starts` holds per run the modal states (m, 2) it begins with: the bench is never quite at rest. `noises` has one
    entry per axis; `noise_seed` and `effect_seed` fix everything that is random.
    """

    plant: Plant
    runs: tuple[Run, ...]
    starts: tuple[Array, ...]
    noises: tuple[Noise, ...]
    noise_seed: int
    effect_seed: int

    def coarse(self, substeps: int) -> Campaign:
        """Return the same campaign computed on another fine grid."""
        runs = tuple(replace(r, excitation=replace(r.excitation, substeps=substeps)) for r in self.runs)
        return replace(self, runs=runs)

    def motions(self, hidden: Sequence[Hidden]) -> list[Motion]:
        """Return the true motion of every run under `hidden` effects."""
        return [
            move(self.plant, hidden, run.excitation, start, self._chance(i))
            for i, (run, start) in enumerate(zip(self.runs, self.starts, strict=True))
        ]

    def noise(self) -> list[Array]:
        """Return the measurement noise of every run, (n, axes)."""
        rng = np.random.default_rng([self.noise_seed, 0])
        return [np.stack([x.draw(run.excitation.n, rng) for x in self.noises], axis=1) for run in self.runs]

    def readings(self, hidden: Sequence[Hidden], noise: Sequence[Array]) -> list[Array]:
        """Return what is recorded in every run, (n, axes), under `hidden` effects and `noise`."""
        return [
            read(motion, hidden, run.excitation, added, self._chance(100 + i))
            for i, (run, motion, added) in enumerate(zip(self.runs, self.motions(hidden), noise, strict=True))
        ]

    def scene(self) -> Scene:
        """Return the sizes of the undisturbed motion, from which effects are drawn."""
        motions = self.motions(())
        u = np.vstack([r.excitation.command for r in self.runs])
        y = np.vstack([m.sampled() for m in motions])
        rate = np.vstack([m.rate for m in motions])
        kelvin = [r.excitation.temperature_k for r in self.runs]
        return Scene(
            u_peak=np.max(np.abs(u), axis=0),
            u_rms=np.sqrt(np.mean(u**2, axis=0)),
            y_peak=np.max(np.abs(y), axis=0),
            y_rms=np.sqrt(np.mean(y**2, axis=0)),
            rate_peak=np.max(np.abs(rate), axis=0),
            rate_rms=np.sqrt(np.mean(rate**2, axis=0)),
            stiffness=self.plant.stiffness,
            plant=self.plant,
            noise_std=np.array([x.std for x in self.noises]),
            rate_hz=RATE_HZ,
            run_s=max(r.excitation.n for r in self.runs) / RATE_HZ,
            kelvin=float(np.ptp(np.concatenate(kelvin))),
            places=tuple(range(self.plant.n_axes)),
        )

    def _chance(self, label: int) -> np.random.Generator:
        return np.random.default_rng([self.effect_seed, label])


def draw_campaign(rng: np.random.Generator, shape: str, n_axes: int) -> Campaign:
    """Return a random bench and campaign; the noise is 0.05–0.5 % of the motion."""
    plant = draw_plant(rng, n_axes)
    runs = draw_runs(rng, plant, shape)
    swing = np.array([np.sqrt(np.mean((r.excitation.command / plant.stiffness) ** 2, axis=0)) for r in runs]).max(
        axis=0
    )
    noises = tuple(
        draw_noise(rng, float(s) * float(np.exp(rng.uniform(np.log(5e-4), np.log(5e-3)))), RATE_HZ) for s in swing
    )
    starts = tuple(_start(rng, plant, swing) for _ in runs)
    seeds = rng.integers(2**31, size=2)
    return Campaign(plant, runs, starts, noises, int(seeds[0]), int(seeds[1]))


def _start(rng: np.random.Generator, plant: Plant, swing: Array) -> Array:
    """Return modal states of up to a fifth of the swing in the suspensions, a hundredth in the other modes."""
    reach = np.concatenate([0.2 * swing, np.full(plant.n_modes - plant.n_axes, 0.01 * float(np.max(swing)))])
    state = rng.uniform(-1.0, 1.0, (plant.n_modes, 2)) * reach[:, None]
    state[:, 1] *= plant.omega_rad_s
    return np.asarray(state)
