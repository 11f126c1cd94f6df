"""A bench and what is played on it, in open loop or in a position loop, and its motion with laws hidden."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.challenge.second.excite import REPEATING, SINGLE, Record, draw_records
from analysis.challenge.second.integrate import Motion, Placed, exponentials, integrate, split_delay
from analysis.challenge.second.law import Scene, log_uniform
from analysis.challenge.second.noise import Noise, draw_noise
from analysis.challenge.second.plant import Plant, draw_plant

Array = NDArray[np.float64]

RATES_HZ = (500.0, 1000.0, 2000.0, 2500.0, 4000.0, 5000.0, 10000.0, 20000.0)


@dataclass(frozen=True)
class Campaign:
    """Plant, runs and noise. `control` (axes, 4) is None in open loop, where records are commands, else references.

    `scale` (axes,) is what a waveform of level 1 is in its unit. `starts` has modal states (m, 2) for every run,
    `noise` (n, axes) for every run what the sensor adds; `louder` is by how much the noise grows with the level.
    """

    plant: Plant
    rate_hz: float
    records: tuple[Record, ...]
    scale: Array
    control: Array | None
    noises: tuple[Noise, ...]
    noise: tuple[Array, ...]
    louder: float
    starts: tuple[Array, ...]
    kelvin: float
    kelvin_hz: float
    chance: int
    traits: dict[str, str]

    def play(self, laws: list[Placed], finer: int = 1) -> list[Motion]:
        """Return the motion of every run with these laws hidden; readings are without noise, commands with its part."""
        late = sum(float(x.p[0]) for x in laws if x.law.how == "delay")
        motions = []
        for index, (record, noise, start) in enumerate(zip(self.records, self.noise, self.starts, strict=True)):
            played, nothing = self.scale * record.wave, np.zeros_like(record.wave)
            external, reference = (played, nothing) if self.control is None else (nothing, played)
            motion = integrate(
                self.plant,
                self.rate_hz,
                external,
                reference,
                noise,
                self.control,
                self._start(start),
                laws,
                extra_delay_s=late,
                finer=finer,
            )
            motions.append(self._recorded(motion, laws, index))
        return motions

    def _recorded(self, motion: Motion, laws: list[Placed], index: int) -> Motion:
        """Return the motion with its readings as the record has them."""
        reading = motion.reading.copy()
        for x in laws:
            if x.law.how == "record":
                rng = np.random.default_rng([self.chance, index])
                reading[:, x.i] = x.law.function(reading[:, x.i], motion.v[:, x.i], x.p, self.rate_hz, rng)
        return replace(motion, reading=reading)

    def _start(self, start: Array) -> Array:
        """Return a start for the modes that the plant has by now."""
        return np.vstack([start, np.zeros((self.plant.omega.size - start.shape[0], 2))])

    def linear(self, command: Array, plant: Plant | None = None) -> Array:
        """Return how each mode answers commands (n, inputs) from rest, (n, modes, inputs)."""
        plant = plant or self.plant
        whole, part = split_delay(plant.delay_s, self.rate_hz)
        period = 1.0 / self.rate_hz
        move, _ = exponentials(plant.omega, plant.decay, period)
        rest, late = exponentials(plant.omega, plant.decay, (1.0 - part) * period)
        _, early = exponentials(plant.omega, plant.decay, part * period)
        first = np.einsum("mij,mj->mi", rest, early)
        out = np.zeros((command.shape[0], plant.omega.size, command.shape[1]))
        for m in range(plant.omega.size):
            p = move[m]
            denominator = np.array([1.0, -np.trace(p), np.linalg.det(p)])
            numerator = np.zeros(whole + 4)
            for g, lag in ((late[m], whole + 1), (first[m], whole + 2)):
                numerator[lag] += g[0]
                if lag + 1 < numerator.size:
                    numerator[lag + 1] += p[0, 1] * g[1] - p[1, 1] * g[0]
            out[:, m] = scipy.signal.lfilter(numerator, denominator, command, axis=0)
        return out

    def answer(self, command: Array, plant: Plant | None = None) -> Array:
        """Return the readings (n, axes) of the linear plant that starts at rest."""
        plant = plant or self.plant
        each = (self.linear(command, plant) * plant.drive).sum(axis=2)
        return np.asarray(each @ plant.shape.T)

    def scene(self, motions: list[Motion], axis: int) -> Scene:
        """Return what the motion of one axis is like."""
        y, v, u = (np.concatenate([getattr(m, what)[:, axis] for m in motions]) for what in ("y", "v", "command"))
        plant = self.plant
        omega, gain = float(plant.omega[axis]), float(plant.drive[axis, axis])
        centre = float(np.sqrt(np.mean(v**2) / max(np.mean((y - np.mean(y)) ** 2), 1e-300))) / (2.0 * np.pi)
        return Scene(
            y_rms=float(np.sqrt(np.mean(y**2))),
            y_peak=float(np.max(np.abs(y))),
            v_rms=float(np.sqrt(np.mean(v**2))),
            v_peak=float(np.max(np.abs(v))),
            u_rms=float(np.sqrt(np.mean(u**2))),
            u_peak=float(np.max(np.abs(u))),
            stiffness=omega**2 / gain,
            frequency_hz=omega / (2.0 * np.pi) if omega else centre,
            inertia=1.0 / gain,
            rate_hz=self.rate_hz,
            run_s=max(r.n for r in self.records) / self.rate_hz,
            kelvin=self.kelvin,
            kelvin_hz=self.kelvin_hz,
        )


def draw_campaign(rng: np.random.Generator, axes: int) -> Campaign:
    """Return a random bench with what is played on it; its noise is 0.03 to 2 % of the motion."""
    rate_hz = float(rng.choice(RATES_HZ))
    period = int(rng.choice([1024, 1500, 2000, 2048, 3000]))
    rigid, closed = rng.random() < 0.35, rng.random() < 0.5
    closed = closed or (rigid and rng.random() < 0.8)
    plant = draw_plant(rng, rate_hz, axes, bool(rigid), 4.0 * rate_hz / period)
    kind = REPEATING if rng.random() < 0.5 else str(rng.choice(SINGLE))
    held = str(rng.choice(["rows", "run"]))
    own = plant.omega[:axes] / (2.0 * np.pi * rate_hz)
    slow, fast = 3.0 / period, float(np.max(plant.omega)) / (2.0 * np.pi * rate_hz)
    control = _draw_control(rng, plant, rate_hz) if closed else None
    high = min(0.4, 1.3 * max(fast, float(np.max(own))))
    if control is not None:
        high = float(min(0.2, 2.0 * _bandwidth(plant, control) / (2.0 * np.pi * rate_hz)))
    records = draw_records(rng, kind, held, axes, period, slow, max(high, 3.0 * slow))
    at_rest = bool(rng.random() < 0.5)
    traits = {
        "loop": "closed" if closed else "open",
        "excitation": "repeats" if kind == REPEATING else "single",
        "waveform": kind,
        "axis": "rigid" if rigid else "springy",
        "axes": str(axes),
        "rate": "below 2 kHz" if rate_hz < 2000 else "2 to 5 kHz" if rate_hz <= 5000 else "above 5 kHz",
        "held-out": held,
        "start": "rest" if at_rest else "motion",
    }
    kelvin_hz = rng.uniform(0.3, 2.0) * rate_hz / records[0].n
    bare = Campaign(
        plant,
        rate_hz,
        records,
        log_uniform(rng, 1e-4, 1e-1) * np.exp(rng.uniform(-0.7, 0.7, axes)),
        control,
        (),
        tuple(np.zeros_like(r.wave) for r in records),
        float(rng.choice([0.0, rng.uniform(0.3, 1.0)], p=[0.8, 0.2])),
        tuple(np.zeros((plant.omega.size, 2)) for _ in records),
        log_uniform(rng, 0.5, 5.0),
        kelvin_hz,
        int(rng.integers(2**31)),
        traits,
    )
    return _with_noise(rng, bare, at_rest)


def _bandwidth(plant: Plant, control: Array) -> float:
    """Return the frequency (rad/s) at which the proportional gain meets the inertia, of the slowest axis."""
    return float(min(np.sqrt(control[a, 0] * plant.drive[a, a]) for a in range(plant.axes)))


def _draw_control(rng: np.random.Generator, plant: Plant, rate_hz: float) -> Array:
    """Return gains of a PD or PID loop on every axis, below the flexible modes and what the delay allows."""
    above = np.append(plant.omega[plant.axes :], 2.0 * np.pi * rate_hz / 8.0)
    late = 2.0 / rate_hz + plant.delay_s
    gains = np.zeros((plant.axes, 4))
    for a in range(plant.axes):
        omega = min(float(np.min(above)) * rng.uniform(0.1, 0.35), rng.uniform(0.1, 0.2) / late)
        inertia = 1.0 / float(plant.shape[a] @ plant.drive[:, a])
        gains[a, 0] = inertia * omega**2
        gains[a, 2] = inertia * omega * rng.uniform(1.0, 1.8)
        gains[a, 1] = gains[a, 0] * omega * rng.uniform(0.02, 0.1) if rng.random() < 0.5 else 0.0
        gains[a, 3] = np.exp(-8.0 * omega / rate_hz)
    return gains


def _with_noise(rng: np.random.Generator, bare: Campaign, at_rest: bool) -> Campaign:
    """Return a campaign with noise in proportion to the motion, and with starts."""
    if bare.control is None:
        moved = np.vstack([bare.answer(r.wave) for r in bare.records])
        bare = replace(bare, scale=bare.scale / np.sqrt(np.mean(moved**2, axis=0)))
        played = [bare.answer(bare.scale * r.wave) for r in bare.records]
    else:
        played = [bare.scale * r.wave for r in bare.records]
    swing = np.sqrt(np.mean(np.vstack(played) ** 2, axis=0))
    noises = tuple(draw_noise(rng, float(s) * log_uniform(rng, 3e-4, 2e-2)) for s in swing)
    noise = tuple(
        np.column_stack([x.draw(r.n, rng) for x in noises]) * (1.0 + bare.louder * r.levels()[:, None])
        for r in bare.records
    )
    starts = list(bare.starts)
    if not at_rest:
        held = 1 if bare.traits["held-out"] == "run" else 0  # a run that is held out as a whole begins at rest
        for index in range(len(starts) - held):
            start = np.zeros_like(starts[index])
            for a in range(bare.plant.axes):
                start[a] = 0.2 * swing[a] * rng.uniform(-1.0, 1.0, 2) * np.array([1.0, bare.plant.omega[a]])
            starts[index] = start
    return replace(bare, noises=noises, noise=noise, starts=tuple(starts))
