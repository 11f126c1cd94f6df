"""What is played on a hidden bench: campaigns of several runs, the same for every family.

Three shapes: *full* (periodic multisines at three amplitudes, slow loops, steps, a chirp, rest, a run during which the
temperature changes), *aperiodic* (the same without any repetition) and *short* (one run of a tenth of the length).
Every shape changes the temperature, and holds out stretches of another amplitude and waveform.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.challenge.motion import Excitation
from analysis.challenge.plant import Plant

Array = NDArray[np.float64]

RATE_HZ = 4000.0
PERIOD = 4000
START_K = 77.0

SHAPES = {"full": 0.7, "aperiodic": 0.2, "short": 0.1}
"""Shapes of a campaign, with the part of the cases that have each."""


@dataclass(frozen=True)
class Stretch:
    """One segment of a run: label, samples, and what the log says of it."""

    label: str
    n: int
    settings: dict[str, float | str]

    @property
    def held_out(self) -> bool:
        """Whether it is kept from every fit."""
        return "held-out" in self.label


@dataclass(frozen=True)
class Run:
    """One run: its name, its segments in order, and what is played."""

    name: str
    stretches: tuple[Stretch, ...]
    excitation: Excitation

    def rows(self, held_out: bool) -> NDArray[np.bool_]:
        """Return which samples are held out (or are not), shape (n,)."""
        return np.concatenate([np.full(s.n, s.held_out is held_out) for s in self.stretches])


@dataclass(frozen=True)
class _Player:
    """Draws waveforms (n, axes) that move each axis of `plant` by about 1 at most."""

    plant: Plant
    rng: np.random.Generator

    def axes(self, wave: Callable[[int], Array]) -> Array:
        return np.stack([wave(a) for a in range(self.plant.n_axes)], axis=1)

    def rest(self, n: int) -> Array:
        return np.zeros((n, self.plant.n_axes))

    def multisine(self, n: int, stop_hz: float = 0.1 * RATE_HZ) -> Array:
        """Lines of equal amplitude up to `stop_hz`, random phases; the plant's response sets the motion's peak."""
        lines = np.arange(1, int(stop_hz * n / RATE_HZ) + 1)
        response = self.plant.response(lines * RATE_HZ / n)

        def wave(a: int) -> Array:
            spectrum = np.zeros(n // 2 + 1, dtype=complex)
            spectrum[lines] = np.exp(2j * np.pi * self.rng.random(lines.size))
            moved = np.zeros_like(spectrum)
            moved[lines] = spectrum[lines] * response[:, a, a]
            return np.asarray(np.fft.irfft(spectrum, n) / np.max(np.abs(np.fft.irfft(moved, n))))

        return self.axes(wave)

    def loops(self, cycles: int, n: int) -> Array:
        """Slow sines: `cycles` on the first axis, one more on the next, so that the axes can be distinguished."""
        time = np.arange(n) / n
        return self.axes(lambda a: np.asarray(self.plant.stiffness[a] * np.sin(2.0 * np.pi * (cycles + a) * time)))

    def steps(self, n: int) -> Array:
        """Random levels, each approached along half a cosine; two thirds of the range, for the overshoot."""
        move, dwell = 60, 400
        ramp = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, move + 1) / move)

        def wave(a: int) -> Array:
            out, level = np.empty(n), 0.0
            for first in range(0, n, move + dwell):
                target = 0.0 if first + move + dwell >= n else self.rng.uniform(-1.0, 1.0)
                part = np.concatenate([level + (target - level) * ramp, np.full(dwell, target)])[: n - first]
                out[first : first + part.size] = part
                level = target
            return np.asarray(out * self.plant.stiffness[a] / 1.5)

        return self.axes(wave)

    def chirp(self, n: int, stop_hz: float = 0.1 * RATE_HZ) -> Array:
        """An exponential sweep from 1 Hz to `stop_hz`, of an amplitude that the largest resonance allows."""
        time = np.arange(n) / RATE_HZ
        span = np.log(stop_hz) / time[-1]
        phase = 2.0 * np.pi * (np.exp(span * time) - 1.0) / span
        response = np.abs(self.plant.response(np.geomspace(1.0, stop_hz, 2000)))
        return self.axes(lambda a: np.asarray(0.8 * np.sin(phase + a) / np.max(response[:, a, a])))


def draw_runs(rng: np.random.Generator, plant: Plant, shape: str) -> tuple[Run, ...]:
    """Return the runs of a campaign of this shape on a bench like `plant`."""
    player = _Player(plant, rng)
    swing_rad = float(np.exp(rng.uniform(np.log(1e-3), np.log(8e-3))))
    warmer_k = rng.uniform(4.0, 10.0)
    pieces = {"full": _full, "aperiodic": _aperiodic, "short": _short}[shape](player)
    return tuple(_run(f"run-{i + 1}", parts, swing_rad, warmer_k) for i, parts in enumerate(pieces))


_Piece = tuple[str, float, Array, float]
"""Label, amplitude, one period of the waveform, and how many periods are played."""


def _run(name: str, parts: list[_Piece], swing_rad: float, warmer_k: float) -> Run:
    stretches, waves, kelvin = [], [], []
    for label, amplitude, wave, periods in parts:
        n = int(round(periods * wave.shape[0]))
        settings: dict[str, float | str] = {"phase": label.removeprefix("held-out "), "amplitude": amplitude}
        if periods > 1.0:
            settings |= {"period_samples": wave.shape[0], "transient_periods": 1, "periods": periods - 1.0}
        stretches.append(Stretch(label, n, settings))
        waves.append(np.tile(wave, (int(np.ceil(periods)), 1))[:n] * (amplitude * swing_rad))
        kelvin.append(np.full(n, 1.0 if "warming" in label else 0.0))
    rise = np.cumsum(np.concatenate(kelvin))
    temperature_k = START_K + warmer_k * rise / max(float(rise[-1]), 1.0)
    return Run(name, tuple(stretches), Excitation(np.vstack(waves), temperature_k, RATE_HZ, START_K))


def _full(p: _Player) -> list[list[_Piece]]:
    wave = p.multisine(PERIOD)
    return [
        [(f"multisine {level}", gain, wave, 4.0) for level, gain in (("low", 0.3), ("middle", 0.6), ("high", 1.0))],
        [
            ("rest", 1.0, p.rest(4000), 1.0),
            ("loops small", 0.5, p.loops(2, 8000), 1.0),
            ("loops large", 1.0, p.loops(2, 8000), 1.0),
            ("steps", 1.0, p.steps(16000), 1.0),
            ("chirp", 0.7, p.chirp(8000), 1.0),
            ("held-out steps", 0.8, p.steps(8000), 1.0),
            ("held-out noise", 0.5, p.multisine(8000, 0.07 * RATE_HZ), 1.0),
        ],
        [
            ("steps cold", 0.8, p.steps(6000), 1.0),
            ("steps warming", 0.8, p.steps(14000), 1.0),
            ("steps warm", 0.8, p.steps(8000), 1.0),
        ],
    ]


def _aperiodic(p: _Player) -> list[list[_Piece]]:
    return [
        [
            ("noise high", 1.0, p.multisine(20000), 1.0),
            ("chirp", 0.8, p.chirp(12000), 1.0),
            ("noise low", 0.4, p.multisine(16000), 1.0),
        ],
        [
            ("loops", 1.0, p.loops(3, 12000), 1.0),
            ("steps", 1.0, p.steps(20000), 1.0),
            ("held-out steps", 0.7, p.steps(8000), 1.0),
            ("held-out noise", 0.6, p.multisine(8000, 0.07 * RATE_HZ), 1.0),
        ],
        [
            ("steps cold", 0.8, p.steps(6000), 1.0),
            ("steps warming", 0.8, p.steps(14000), 1.0),
            ("steps warm", 0.8, p.steps(8000), 1.0),
        ],
    ]


def _short(p: _Player) -> list[list[_Piece]]:
    return [
        [
            ("multisine", 0.8, p.multisine(2000), 3.0),
            ("loops", 1.0, p.loops(1, 2000), 1.0),
            ("steps warming", 1.0, p.steps(4000), 1.0),
            ("held-out steps", 0.7, p.steps(1600), 1.0),
            ("held-out noise", 0.5, p.multisine(1600, 0.07 * RATE_HZ), 1.0),
        ]
    ]
