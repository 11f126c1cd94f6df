"""Records of benches that are linear, by formulas of their own: nothing comes from the product.

States go from sample to sample by the matrix exponential, which is exact for held drives. Noise is white, with a part
that rises below some hertz. Numbers and seeds were fixed before any of these records had been diagnosed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, expm
from scipy.signal import lfilter

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Record:
    """Drives (n, inputs), readings (n, outputs), reference (n,) or None; labels with rows; rows per period or None."""

    drives: Array
    readings: Array
    rate_hz: float
    parts: Sequence[tuple[str, int]]
    period: int | None
    reference: Array | None = None


def held(a: Array, b: Array, rate_hz: float) -> tuple[Array, Array]:
    """Return transition (s, s) and input matrix (s, k) over one sample with held inputs."""
    s, k = b.shape
    whole = expm(np.block([[a, b], [np.zeros((k, s + k))]]) / rate_hz)
    return whole[:s, :s], whole[:s, s:]


def oscillator(frequency_hz: float, damping_ratio: float) -> Array:
    """Return the matrix (2, 2) of position and rate of one mode."""
    omega = 2.0 * np.pi * frequency_hz
    return np.array([[0.0, 1.0], [-(omega**2), -2.0 * damping_ratio * omega]])


def played(a: Array, b: Array, c: Array, u: Array, rate_hz: float) -> Array:
    """Return c x (n, outputs) of x' = a x + b u from rest under held drives `u` (n, inputs)."""
    over, into = held(a, b, rate_hz)
    x, out = np.zeros(a.shape[0]), np.empty((len(u), len(c)))
    for k, drive in enumerate(u):
        out[k] = c @ x
        x = over @ x + into @ drive
    return out


def multisine(rng: np.random.Generator, period: int, lines: slice) -> Array:
    """Return one period (period,) of unit rms with random phases on the `lines`."""
    spectrum = np.zeros(period // 2 + 1, dtype=complex)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(spectrum[lines].size))
    wave = np.fft.irfft(spectrum, period)
    return wave / wave.std()


def noise(rng: np.random.Generator, n: int, rms: float, corner_hz: float, rate_hz: float) -> Array:
    """Return white noise (n,) of `rms` beside a part of first order below `corner_hz` with twice its density there."""
    keep = np.exp(-2.0 * np.pi * corner_hz / rate_hz)
    return rms * (rng.standard_normal(n) + lfilter([1.0 - keep], [1.0, -keep], rng.standard_normal(n)))


def realisations(
    rng: np.random.Generator, period: int, periods: int, lines: slice, sizes: dict[str, float], inputs: int
) -> Array:
    """Return drives (n, inputs): one realisation per label, each input's phases its own, `periods` times."""
    parts = [
        np.tile(size * np.column_stack([multisine(rng, period, lines) for _ in range(inputs)]), (periods, 1))
        for size in sizes.values()
    ]
    return np.concatenate(parts)


def two_by_two(seed: int = 501) -> Record:
    """Two drives, two sensors, two modes that each of them moves: 15,360 rows at 1000 Hz."""
    rng, rate_hz, period, periods = np.random.default_rng(seed), 1000.0, 1024, 3
    sizes = {"first": 1.0, "second": 1.0, "third": 0.6, "fourth": 0.6, "held-out": 0.8}
    u = realisations(rng, period, periods, slice(2, 200), sizes, 2)
    at_drive, at_sensor = np.array([[1.0, 0.3], [-0.4, 1.0]]), np.array([[1.0, 0.25], [-0.35, 1.1]])
    a = block_diag(oscillator(31.0, 0.04), oscillator(58.0, 0.03))
    b, c = np.zeros((4, 2)), np.zeros((2, 4))
    b[1::2], c[:, ::2] = at_drive * (2.0 * np.pi * np.array([[31.0], [58.0]])) ** 2, at_sensor * 1e-6
    y = played(a, b, c, u, rate_hz)
    y += np.column_stack([noise(rng, len(u), 3e-3 * column.std(), 4.0, rate_hz) for column in y.T])
    return Record(u, y, rate_hz, [(label, period * periods) for label in sizes], period)


def rigid_axis(seed: int = 502) -> Record:
    """A mass on air with a little drag and no spring: 24,000 rows at 500 Hz."""
    rng, rate_hz, period, periods = np.random.default_rng(seed), 500.0, 2000, 3
    sizes = {"first": 1.0, "second": 0.7, "third": 1.3, "held-out": 0.9}
    u = realisations(rng, period, periods, slice(2, 240), sizes, 1)
    mass, drag = 3.2, 4.5  # drive units per m/s² and per m/s
    y = played(np.array([[0.0, 1.0], [0.0, -drag / mass]]), np.array([[0.0], [1.0 / mass]]), np.eye(1, 2), u, rate_hz)
    y[:, 0] += noise(rng, len(u), 2e-7, 3.0, rate_hz)
    return Record(u, y, rate_hz, [(label, period * periods) for label in sizes], period)


def closed_loop(seed: int = 503) -> Record:
    """A mode at 20 Hz in a proportional-integral loop, moved by its reference; what is read is fed back with its noise.

    16,000 rows at 500 Hz.
    """
    rng, rate_hz, period, periods = np.random.default_rng(seed), 500.0, 1000, 4
    sizes = {"first": 1.0, "second": 0.6, "third": 1.4, "held-out": 0.8}
    reference = 1e-3 * realisations(rng, period, periods, slice(1, 120), sizes, 1)[:, 0]
    omega = 2.0 * np.pi * 20.0
    over, into = held(oscillator(20.0, 0.1), np.array([[0.0], [1e-3 * omega**2]]), rate_hz)  # 1 mm per unit at rest
    disturbance = noise(rng, reference.size, 4e-6, 5.0, rate_hz)
    x, summed, u, y = np.zeros(2), 0.0, np.empty((reference.size, 1)), np.empty((reference.size, 1))
    for k in range(reference.size):
        y[k] = x[0] + disturbance[k]
        error = reference[k] - y[k, 0]
        summed += error / rate_hz
        u[k] = 300.0 * error + 8000.0 * summed
        x = over @ x + into @ u[k]
    return Record(u, y, rate_hz, [(label, period * periods) for label in sizes], period, reference)


def short(seed: int = 504) -> Record:
    """500 rows at 200 Hz of a mode at 12 Hz under steps of random size: two seconds and a half, nothing repeats."""
    rng, rate_hz, n = np.random.default_rng(seed), 200.0, 500
    u = np.repeat(rng.standard_normal(n // 5), 5)[:, None]
    omega = 2.0 * np.pi * 12.0
    y = played(oscillator(12.0, 0.05), np.array([[0.0], [1e-3 * omega**2]]), np.eye(1, 2), u, rate_hz)
    y[:, 0] += noise(rng, n, 5e-3 * y.std(), 2.0, rate_hz)
    return Record(u, y, rate_hz, [("train", 375), ("held-out end", 125)], None)


def chirp(seed: int = 505) -> Record:
    """1024 rows at 200 Hz of modes at 5.6 and 12.1 Hz under one chirp from 1 to 21 Hz: nothing repeats."""
    rng, rate_hz, n = np.random.default_rng(seed), 200.0, 1024
    t = np.arange(n) / rate_hz
    u = np.sin(2.0 * np.pi * (t + 10.0 * t**2 * rate_hz / n))[:, None]
    a = block_diag(oscillator(5.6, 0.02), oscillator(12.1, 0.04))
    b = np.array([[0.0], [(2.0 * np.pi * 5.6) ** 2], [0.0], [-0.4 * (2.0 * np.pi * 12.1) ** 2]])
    y = played(a, b, np.array([[1e-3, 0.0, 1e-3, 0.0]]), u, rate_hz)
    y[:, 0] += noise(rng, n, 0.02 * y.std(), 1.0, rate_hz)
    return Record(u, y, rate_hz, [("train", 768), ("held-out end", 256)], None)


def accelerometer(seed: int = 506) -> Record:
    """1000 rows at 500 Hz of the acceleration of a flexible arm, which follows the drive at once: nothing repeats."""
    rng, rate_hz, n = np.random.default_rng(seed), 500.0, 1000
    u = multisine(rng, n, slice(2, 160))[:, None]
    modes = [(11.0, 0.02, 1.0), (31.0, 0.01, -0.6), (62.0, 0.015, 0.8)]
    a = block_diag(*[oscillator(f, z) for f, z, _ in modes])
    b = np.array([[x] for _, _, share in modes for x in (0.0, share)])
    c = np.array([[x for f, z, _ in modes for x in (-((2.0 * np.pi * f) ** 2), -4.0 * np.pi * f * z)]])
    y = played(a, b, c, u, rate_hz) + sum(share for *_, share in modes) * u
    y[:, 0] += noise(rng, n, 0.01 * y.std(), 3.0, rate_hz)
    return Record(u, y, rate_hz, [("train", 750), ("held-out end", 250)], None)


MOTOR, LOAD, STIFFNESS, LOSS = 1e-3, 6e-4, 25.0, 4e-3


def coupled(drag: float) -> tuple[Array, Array]:
    """Return the matrices of a motor with `drag` and a load behind a coupling: positions, then rates."""
    spring, damper = np.array([[-1.0, 1.0], [1.0, -1.0]]) * STIFFNESS, np.array([[-1.0, 1.0], [1.0, -1.0]]) * LOSS
    damper[0, 0] -= drag
    masses = np.array([[MOTOR], [LOAD]])
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [spring / masses, damper / masses]])
    return a, np.array([[0.0], [0.0], [1.0 / MOTOR], [0.0]])


def two_inertias(seed: int = 507, drag: float = 6e-3) -> Record:
    """A motor with drag and a load behind a coupling, nothing holds either: 24,000 rows at 500 Hz of the motor.

    Without drag both drift away from the first rows on.
    """
    rng, rate_hz, period, periods = np.random.default_rng(seed), 500.0, 2000, 3
    sizes = {"first": 1.0, "second": 0.6, "third": 1.4, "held-out": 0.8}
    u = 0.15 * realisations(rng, period, periods, slice(2, 350), sizes, 1)
    y = played(*coupled(drag), np.eye(1, 4), u, rate_hz)
    y[:, 0] += noise(rng, len(u), 2e-5, 3.0, rate_hz)
    return Record(u, y, rate_hz, [(label, period * periods) for label in sizes], period)


def moves(rng: np.random.Generator, n: int, rate_hz: float) -> Array:
    """Return places (n,) within a unit to either side: moves of fifth order from 0.4 to 1 s, and rests between them."""
    reference, at, place = np.zeros(n), 0, 0.0
    while at < n:
        there, rows = rng.uniform(-1.0, 1.0), int(rng.uniform(0.4, 1.0) * rate_hz)
        s = np.linspace(0.0, 1.0, rows)
        move = np.concatenate(
            [
                place + (there - place) * (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5),
                np.full(int(rng.uniform(0.1, 0.3) * rate_hz), there),
            ]
        )
        reference[at : at + move.size] = move[: n - at]
        at, place = at + move.size, there
    return reference


def loop_at_once(seed: int = 508) -> Record:
    """A mass with drag in a stiff loop that answers every reading within its own sample: 8000 rows at 500 Hz.

    Nothing repeats, and the noise of the reading is most of what the drive plays above some hertz.
    """
    rng, rate_hz, n = np.random.default_rng(seed), 500.0, 8000
    reference = moves(rng, n, rate_hz)
    inertia, drag = 1.6e-3, 7.8e-3
    over, into = held(np.array([[0.0, 1.0], [0.0, -drag / inertia]]), np.array([[0.0], [1.0 / inertia]]), rate_hz)
    x, before, u, y = np.zeros(2), 0.0, np.empty((n, 1)), np.empty((n, 1))
    for k in range(n):
        y[k] = x[0] + 2e-5 * rng.standard_normal()
        error = reference[k] - y[k, 0]
        u[k] = 1.2 * error + 0.025 * (error - before) * rate_hz
        before = error
        x = over @ x + into @ u[k]
    return Record(u, y, rate_hz, [("train", 6000), ("held-out end", 2000)], None)


def coupling_in_a_loop(seed: int = 512) -> Record:
    """The same motor and load in a loop that answers at once, 10,000 rows at 500 Hz: the coupling hardly shows."""
    rng, rate_hz, n = np.random.default_rng(seed), 500.0, 10_000
    reference = moves(rng, n, rate_hz)
    over, into = held(*coupled(6e-3), rate_hz)
    x, before, u, y = np.zeros(4), 0.0, np.empty((n, 1)), np.empty((n, 1))
    for k in range(n):
        y[k] = x[0] + 2e-5 * rng.standard_normal()
        error = reference[k] - y[k, 0]
        u[k] = 1.2 * error + 0.025 * (error - before) * rate_hz
        before = error
        x = over @ x + into @ u[k]
    return Record(u, y, rate_hz, [("train", 7500), ("held-out end", 2500)], None)


def late_reading(seed: int = 509) -> Record:
    """A mass with drag, pushed by half of what moves it, in a loop: 12,000 rows at 1000 Hz.

    It is read 30 µs after the drive has taken its new value, and the loop answers one sample later.
    """
    rng, rate_hz, n, late = np.random.default_rng(seed), 1000.0, 12_000, 3e-5
    reference = moves(rng, n, rate_hz)
    inertia, drag, push = 2.1e-3, 9e-3, -0.02
    a, b = np.array([[0.0, 1.0], [0.0, -drag / inertia]]), np.array([[0.0], [1.0 / inertia]])
    over, into = held(a, b, rate_hz)
    soon, by_then = held(a, b, 1.0 / late)
    x, before, u, y = np.zeros(2), 0.0, np.zeros((n, 1)), np.empty((n, 1))
    for k in range(n):
        y[k] = (soon @ x + by_then @ (u[k] + push))[0] + 2e-5 * rng.standard_normal()
        error = reference[k] - y[k, 0]
        if k + 1 < n:
            u[k + 1] = 0.7 * error + 0.014 * (error - before) * rate_hz
        before = error
        x = over @ x + into @ (u[k] + push)
    return Record(u, y, rate_hz, [("train", 9000), ("held-out end", 3000)], None)


def mode_and_lag(seed: int = 510) -> Record:
    """500 rows at 50 Hz of a mode at 1.4 Hz behind a lag of 0.3 s, three poles, under steps of random size."""
    rng, rate_hz, n = np.random.default_rng(seed), 50.0, 500
    u = np.repeat(rng.uniform(-1.0, 1.0, n // 5), 5)[:, None]
    a = block_diag(oscillator(1.4, 0.15), np.array([[-1.0 / 0.3]]))
    a[2, 0] = 1.0 / 0.3
    y = played(a, np.array([[0.0], [(2.0 * np.pi * 1.4) ** 2], [0.0]]), np.eye(1, 3, 2), u, rate_hz)
    y[:, 0] += noise(rng, n, 5e-3 * y.std(), 1.0, rate_hz)
    return Record(u, y, rate_hz, [("train", 375), ("held-out end", 125)], None)


RECORDS = {
    "two-by-two": two_by_two,
    "rigid-axis": rigid_axis,
    "closed-loop": closed_loop,
    "short": short,
    "chirp": chirp,
    "accelerometer": accelerometer,
    "two-inertias": two_inertias,
    "drifting-inertias": lambda: two_inertias(511, drag=0.0),
    "loop-at-once": loop_at_once,
    "coupling-in-a-loop": coupling_in_a_loop,
    "late-reading": late_reading,
    "mode-and-lag": mode_and_lag,
}
