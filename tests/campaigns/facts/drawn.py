"""Benches and records drawn by seed: what a fact has to be right about, made without any code of the project."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from campaigns.facts import Seen
from campaigns.log import Channel, LogSegment

RATE_HZ = 1000.0
EXCITATIONS = ("white", "coloured", "steps", "chirp", "multisine", "repeated noise")


@dataclass
class Bench:
    """Modes (rad/sample, damping ratio, gain), a delay in samples, noise and what is not linear."""

    omega: np.ndarray
    damping: np.ndarray
    gain: np.ndarray
    delay: int
    noise: float
    colour: float
    friction: float
    cubic: float


def drawn_bench(rng: np.random.Generator, *, linear: bool = False, delay: int = 0) -> Bench:
    """Return one to three modes below a fifth of the rate with noise of 0.1 % to 10 %, half of them not linear."""
    modes = int(rng.integers(1, 4))
    bent = not linear and rng.uniform() < 0.5
    highest = -1.2 if bent else -0.7  # a force taken from the sample before drives a fast mode
    return Bench(
        omega=2.0 * np.pi * 10.0 ** rng.uniform(-2.3, highest, modes),
        damping=10.0 ** rng.uniform(-1.7, -0.3, modes),
        # a friction on the sum of the modes drives one of another sign
        gain=rng.uniform(0.3, 1.0, modes) * (1.0 if bent else rng.choice([-1.0, 1.0], modes)),
        delay=delay,
        noise=10.0 ** rng.uniform(-3.0, -1.0),
        colour=float(rng.choice([0.0, 0.9, 0.99])),
        friction=float(rng.uniform(0.02, 0.2)) if bent else 0.0,
        cubic=float(rng.uniform(0.02, 0.2)) if bent else 0.0,
    )


def excitation(rng: np.random.Generator, kind: str, rows: int) -> tuple[np.ndarray, int]:
    """Return an input (rows,) of rms one, and its period, 0 where it has none."""
    t = np.arange(rows)
    period = 0
    if kind == "white":
        u = rng.standard_normal(rows)
    elif kind == "coloured":
        sos = scipy.signal.butter(2, rng.uniform(0.05, 0.5), output="sos")
        u = scipy.signal.sosfilt(sos, rng.standard_normal(rows))
    elif kind == "steps":
        hold = int(rng.integers(5, 60))
        u = np.repeat(rng.uniform(-1.0, 1.0, rows // hold + 1), hold)[:rows]
    elif kind == "chirp":
        u = scipy.signal.chirp(t, 0.001, rows, rng.uniform(0.05, 0.3))
    else:
        period = rows // int(rng.integers(4, 9))
        if kind == "repeated noise":
            u = np.tile(rng.standard_normal(period), rows // period + 1)[:rows]
        else:
            lines = np.arange(1, int(period * rng.uniform(0.05, 0.3)), int(rng.integers(1, 3)))
            spectrum = np.zeros(period // 2 + 1, dtype=complex)
            spectrum[lines] = np.exp(2j * np.pi * rng.uniform(size=lines.size))
            u = np.tile(np.fft.irfft(spectrum, period), rows // period + 1)[:rows]
    return u / u.std(), period


def _steps_of(bench: Bench) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a (n, n), b (n,), c (n,) of held inputs, each mode of unit static gain times its own."""
    n = bench.omega.size
    a, b, c = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 1)), np.zeros((1, 2 * n))
    for k, (w, z, g) in enumerate(zip(bench.omega, bench.damping, bench.gain, strict=True)):
        a[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0.0, 1.0], [-(w**2), -2.0 * z * w]]
        b[2 * k + 1, 0], c[0, 2 * k] = g * w**2, 1.0
    held = scipy.signal.cont2discrete((a, b, c, np.zeros((1, 1))), 1.0)
    return held[0], held[1][:, 0], held[2][0]


def _held(a: np.ndarray, b: np.ndarray, c: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return the answer (n,) of modes to held inputs (n,), one after the other."""
    out = np.zeros(u.size)
    for k in range(0, b.size, 2):
        rows = slice(k, k + 2)
        numerator, denominator = scipy.signal.ss2tf(a[rows, rows], b[rows, None], c[None, rows], np.zeros((1, 1)))
        out += scipy.signal.lfilter(numerator[0], denominator, u)
    return out


def played(
    bench: Bench,
    u: np.ndarray,
    rng: np.random.Generator,
    *,
    feedback: float = 0.0,
    disturbance: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the input as it acted and the output (n,); `feedback` is the share of the input that answers the output.

    The feedback takes a leaky sum of the readings, one sample late and no faster than a tenth of the rate.
    """
    a, b, c = _steps_of(bench)
    still = _held(a, b, c, u)
    size = still.std()
    noise = rng.standard_normal(u.size)
    noise = scipy.signal.lfilter([1.0], [1.0, -bench.colour], noise)
    noise *= bench.noise * size / noise.std()
    if disturbance is not None:
        noise = noise + disturbance * size
    if not (bench.friction or bench.cubic or feedback):
        late = np.concatenate([np.zeros(bench.delay), u[: u.size - bench.delay]])
        return u, _held(a, b, c, late) + noise
    x, y, acted, answer = np.zeros(a.shape[0]), np.zeros(u.size), np.array(u), 0.0
    for t in range(u.size):
        motion = float(c @ x)
        y[t] = motion + noise[t]
        acted[t] = u[t] - answer
        answer = 0.9 * answer + 0.1 * feedback * y[t] / size
        force = acted[t - bench.delay] if t >= bench.delay else 0.0
        if bench.friction:
            force -= bench.friction * np.tanh(2.0 * float(x[1::2].sum()) / (size * bench.omega[0]))
        if bench.cubic:
            force -= bench.cubic * (motion / size) ** 3 / 3.0
        x = a @ x + b * min(max(force, -20.0), 20.0)  # np.clip takes longer than all else of a sample
    return acted, y


def seen(u: np.ndarray, y: np.ndarray, period: int = 0, reference: np.ndarray | None = None) -> Seen:
    """Return inputs and outputs, (n,) or (n, k), as one segment of a record."""
    columns, channels = {}, {}
    refs = {} if reference is None else {"reference": reference}
    for role, values in {"input": u, "output": y, **refs}.items():
        for k, column in enumerate(np.atleast_2d(values.T)):
            name = f"{role[0]}{k}"
            columns[name] = np.ascontiguousarray(column)
            channels[name] = Channel(name, "N m" if role == "input" else "rad", role, f"a{k}", RATE_HZ)
    rows = u.shape[0]
    return Seen(
        columns, channels, [LogSegment("record", 0, rows, {"period_samples": period} if period else {})], RATE_HZ
    )
