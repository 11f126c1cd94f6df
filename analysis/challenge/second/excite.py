"""What is played: waveforms that repeat or do not, in stretches of several levels, and what is held out of fits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

REPEATING, SINGLE = "multisine", ("noise", "chirp", "steps", "sines", "stepped-sine")


@dataclass(frozen=True)
class Stretch:
    """A piece of a record: label, samples, and what the log says of it."""

    label: str
    n: int
    level: float
    settings: dict[str, Any]

    @property
    def held_out(self) -> bool:
        """Whether no fit may see it."""
        return "held-out" in self.label


@dataclass(frozen=True)
class Record:
    """One run: its stretches and the waveform of every axis, (n, axes), of unit rms at level 1."""

    stretches: tuple[Stretch, ...]
    wave: Array

    @property
    def n(self) -> int:
        """Samples."""
        return int(self.wave.shape[0])

    def mask(self) -> NDArray[np.bool_]:
        """Tell which samples may be fitted, (n,)."""
        return np.concatenate([np.full(s.n, not s.held_out) for s in self.stretches])

    def levels(self) -> Array:
        """Return the level of every sample, (n,)."""
        return np.concatenate([np.full(s.n, s.level) for s in self.stretches])


def draw_records(
    rng: np.random.Generator, kind: str, held: str, axes: int, period: int, low: float, high: float
) -> tuple[Record, ...]:
    """Return the runs of a campaign; `low` to `high` are the frequencies played, in cycles per sample.

    `held` says where the held-out samples are: "rows" at the end of the run, or a "run" of its own.
    """
    levels = (1.0, 0.5) if rng.random() < 0.7 else (1.0,)
    periods = int(rng.integers(3, 5))
    parts: list[tuple[Stretch, Array]] = []
    for level in levels:
        n = period * periods
        settings: dict[str, Any] = {"level": level}
        if kind == REPEATING:
            settings |= {"period_samples": period, "periods": periods}
            wave = np.tile(_waves(rng, kind, axes, period, low, high), (periods, 1))
        else:
            wave = _waves(rng, kind, axes, n, low, high)
        parts.append((Stretch(f"{kind} at {level:g}", n, level, settings), level * wave))
    other = str(rng.choice([k for k in (REPEATING, "noise", "sines", "steps") if k != kind]))
    level = float(rng.uniform(0.6, 0.9))
    n = 2 * period
    last = (Stretch(f"held-out {other}", n, level, {"level": level}), level * _waves(rng, other, axes, n, low, high))
    if held == "rows":
        return (_record([*parts, last]),)
    return _record(parts), _record([last])


def _record(parts: list[tuple[Stretch, Array]]) -> Record:
    return Record(tuple(s for s, _ in parts), np.vstack([w for _, w in parts]))


def _waves(rng: np.random.Generator, kind: str, axes: int, n: int, low: float, high: float) -> Array:
    columns = [_WAVES[kind](rng, n, low, high) for _ in range(axes)]
    return np.column_stack([c / np.sqrt(np.mean(c**2)) for c in columns])


def _multisine(rng: np.random.Generator, n: int, low: float, high: float) -> Array:
    lines = np.arange(max(1, round(low * n)), max(round(high * n), 3) + 1)
    spectrum = np.zeros(n // 2 + 1, dtype=complex)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(lines.size))
    return np.asarray(np.fft.irfft(spectrum, n))


def _noise(rng: np.random.Generator, n: int, low: float, high: float) -> Array:
    spectrum = np.fft.rfft(rng.standard_normal(n))
    frequency = np.fft.rfftfreq(n)
    spectrum[(frequency < low) | (frequency > high)] = 0.0
    return np.asarray(np.fft.irfft(spectrum, n))


def _chirp(rng: np.random.Generator, n: int, low: float, high: float) -> Array:
    part = np.arange(n) / n
    cycles = low * n * ((high / low) ** part - 1.0) / np.log(high / low)
    return np.asarray(np.sin(2.0 * np.pi * (cycles + rng.random())))


def _steps(rng: np.random.Generator, n: int, low: float, high: float) -> Array:
    held = max(int(0.5 / np.sqrt(low * high)), 2)
    levels = rng.uniform(-1.0, 1.0, n // held + 1)
    return np.asarray(np.repeat(levels - np.mean(levels), held)[:n])


def _sines(rng: np.random.Generator, n: int, low: float, high: float) -> Array:
    frequency = np.exp(rng.uniform(np.log(low), np.log(high), 7))
    at = np.arange(n)[:, None]
    return np.asarray(np.sin(2.0 * np.pi * (frequency * at + rng.random(7))).sum(axis=1))


def _stepped_sine(rng: np.random.Generator, n: int, low: float, high: float) -> Array:
    frequency = np.repeat(np.geomspace(low, high, 8), -(-n // 8))[:n]
    return np.asarray(np.sin(2.0 * np.pi * (np.cumsum(frequency) + rng.random())))


_WAVES = {
    "multisine": _multisine,
    "noise": _noise,
    "chirp": _chirp,
    "steps": _steps,
    "sines": _sines,
    "stepped-sine": _stepped_sine,
}
