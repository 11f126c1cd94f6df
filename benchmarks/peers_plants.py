"""Plants for `benchmarks.peers_identify`, drawn by seed and simulated by scipy alone, not by what identifies them.

A plant is a state space of modes, an amplifier pole and a delay of each input. What is played is held for a sample; a
delay of a part of a sample is simulated exactly, as the hold that changes within the sample. Noise is added to the
readings. The last quarter of the rows is held out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Kind:
    """What a plant is drawn from: numbers of modes, inputs and outputs, the rate, frequencies as parts of it, and more.

    `played` and `coloured` name a drive and a noise; `late` is the range of delays in samples, `whole` rounds them;
    `lag_hz` is the range of the amplifier's pole as a part of the rate. `rigid` makes an axis of the slowest mode that
    nothing holds: "braked" by drag, or "free". `read` is "position" or "acceleration". `damping` is a range of ζ.
    """

    name: str
    rate_hz: float
    modes: int = 1
    inputs: int = 1
    outputs: int = 1
    rows: int = 8000
    band: tuple[float, float] = (0.004, 0.2)
    damping: tuple[float, float] = (0.005, 0.05)
    played: str = "white"
    coloured: str = "white"
    noise: float = 0.01
    late: tuple[float, float] = (0.0, 0.0)
    whole: bool = True
    lag_hz: tuple[float, float] | None = None
    rigid: str = ""
    read: str = "position"


KINDS: tuple[Kind, ...] = (
    Kind("one mode", 1000.0),
    Kind("one slow mode, steps", 50.0, band=(0.01, 0.03), played="steps", noise=0.003),
    Kind("two modes", 2000.0, 2),
    Kind("three modes, periodic", 1000.0, 3, played="multisine"),
    Kind("four light modes", 2000.0, 4, damping=(0.002, 0.01), noise=0.003),
    Kind("five modes", 5000.0, 5),
    Kind("six modes to 2 kHz", 10_000.0, 6, band=(0.003, 0.2), rows=12_000, noise=0.003),
    Kind("braked rigid axis", 500.0, 1, rigid="braked", noise=0.003),
    Kind("rigid axis and a mode", 1000.0, 2, rigid="free", band=(0.01, 0.1), noise=0.001),
    Kind("one mode, whole delay", 1000.0, late=(3.0, 12.0)),
    Kind("two modes, whole delay", 2000.0, 2, late=(5.0, 10.0)),
    Kind("two modes, part of a sample late", 2000.0, 2, late=(0.2, 0.8), whole=False),
    Kind("three modes, late and lagged", 5000.0, 3, late=(1.2, 4.8), whole=False, lag_hz=(0.05, 0.2), rows=10_000),
    Kind("one mode, amplifier pole", 1000.0, lag_hz=(0.02, 0.1)),
    Kind("two modes, chirp", 2000.0, 2, band=(0.005, 0.05), played="chirp"),
    Kind("two modes, 2 x 2", 1000.0, 2, 2, 2),
    Kind("four modes, 2 x 2, late", 2000.0, 4, 2, 2, late=(1.0, 5.0)),
    Kind("three modes, 3 x 3", 1000.0, 3, 3, 3),
    Kind("six modes, 3 x 3", 2000.0, 6, 3, 3, rows=10_000, noise=0.003),
    Kind("two modes, two drives", 1000.0, 2, 2, 1),
    Kind("two modes, two readings", 1000.0, 2, 1, 2),
    Kind("two modes, drifting noise", 1000.0, 2, coloured="drifting", noise=0.1),
    Kind("three modes, humming noise", 2000.0, 3, coloured="humming", noise=0.05),
    Kind("a mode that rings on", 500.0, 1, damping=(0.0003, 0.001), band=(0.02, 0.1)),
    Kind("two modes, smooth drive", 1000.0, 2, band=(0.005, 0.05), played="smooth"),
    Kind("three modes, acceleration", 500.0, 3, read="acceleration", band=(0.03, 0.3), rows=3000),
    Kind("a lag", 100.0, 1, damping=(1.5, 4.0), band=(0.005, 0.02), played="steps"),
    Kind("three modes, hardly any noise", 2000.0, 3, noise=1e-5),
    Kind("two modes, periodic, late", 1000.0, 2, played="multisine", late=(2.0, 12.0)),
    Kind("two light modes, long", 5000.0, 2, rows=80_000, damping=(0.001, 0.01)),
    Kind("three modes, long and late", 2000.0, 3, rows=80_000, late=(1.2, 20.0), whole=False),
)


@dataclass(frozen=True)
class Record:
    """What was played (n, n_u) and read (n, n_y); rows from `fitted` on are held out; `period` is 0 for none.

    `floor` (n_y,) is the error of the true plant there: rms of the noise over rms of the reading.
    """

    kind: Kind
    inputs: Array
    outputs: Array
    rate_hz: float
    fitted: int
    period: int
    floor: Array


def drawn(kind: Kind, seed: int) -> Record:
    """Return the record of one plant of a kind; the same seed gives the same bits."""
    rng = np.random.default_rng([seed, *kind.name.encode()])
    a, b, c, d = state_space(kind, rng)
    n = kind.rows
    u, period = _played(kind, rng)
    late = rng.uniform(*kind.late, size=kind.inputs)
    clean = simulated(a, b, c, d, u, np.rint(late) if kind.whole else late, kind.rate_hz)
    size = np.std(clean, axis=0)
    if kind.rigid:  # what drifts is read against its swing from sample to sample over a tenth of the record
        size = np.minimum(size, np.std(clean[n // 10 :] - clean[: -(n // 10)], axis=0))
    y = clean + kind.noise * size * _noise(kind, rng)
    fitted = 3 * n // 4 if not period else n - n // period // 4 * period
    kept = slice(n - period if period else fitted, n)
    floor = np.std((y - clean)[kept], axis=0) / np.std(y[kept], axis=0)
    return Record(kind, u, y, kind.rate_hz, fitted, period, floor)


def state_space(kind: Kind, rng: np.random.Generator) -> tuple[Array, Array, Array, Array]:
    """Return a continuous state space (A, B, C, D) of the plant's modes behind its amplifier."""
    m, n_u, n_y = kind.modes, kind.inputs, kind.outputs
    edges = np.geomspace(*kind.band, m + 1)
    # one in each part of the band, apart by a tenth of it at least
    parts = rng.uniform(0.1, 0.9, size=m)
    omega = 2.0 * np.pi * kind.rate_hz * edges[:-1] * (edges[1:] / edges[:-1]) ** parts
    least, most = np.log(kind.damping)
    zeta = np.exp(rng.uniform(least, most, size=m))
    stiffness, drag = omega**2, 2.0 * zeta * omega
    shape_in, shape_out = rng.normal(size=(m, n_u)), rng.normal(size=(n_y, m))
    if n_u == 1 and n_y == 1:  # no mode that hardly shows
        shape_in, shape_out = np.sign(shape_in), np.sign(shape_out) * rng.uniform(0.5, 1.5, size=(n_y, m))
    if kind.rigid:
        drag[0] = rng.uniform(0.002, 0.01) * kind.rate_hz if kind.rigid == "braked" else 0.0
        stiffness[0] = 0.0
    size = omega**2 * np.sqrt(zeta)  # resonances of about one size
    a = np.zeros((2 * m, 2 * m))
    a[:m, m:] = np.eye(m)
    a[m:, :m], a[m:, m:] = -np.diag(stiffness), -np.diag(drag)
    b = np.vstack([np.zeros((m, n_u)), size[:, None] * shape_in])
    c, d = np.hstack([shape_out, np.zeros((n_y, m))]), np.zeros((n_y, n_u))
    if kind.read == "acceleration":
        d = shape_out / omega**2 @ b[m:]
        c = np.hstack([shape_out, shape_out]) / np.tile(omega**2, 2) * np.tile(np.r_[-stiffness, -drag], (n_y, 1))
    if kind.lag_hz is None:
        return a, b, c, d
    pole = 2.0 * np.pi * kind.rate_hz * rng.uniform(*kind.lag_hz)
    whole = np.block([[a, b], [np.zeros((n_u, 2 * m)), -pole * np.eye(n_u)]])
    return whole, np.vstack([0.0 * b, pole * np.eye(n_u)]), np.hstack([c, d]), 0.0 * d


def simulated(a: Array, b: Array, c: Array, d: Array, u: Array, late: Array, rate_hz: float) -> Array:
    """Return the reading (n, n_y) of inputs (n, n_u) held for a sample each and `late` (n_u,) samples late."""
    n, order = a.shape[0], u.shape[0]
    step = 1.0 / rate_hz
    state_step = scipy.linalg.expm(a * step)
    drive = np.zeros((order, n))
    direct = np.zeros((order, c.shape[0]))
    for j in range(u.shape[1]):
        whole, part = int(np.floor(late[j])), float(late[j] % 1.0)
        before, now = (np.r_[np.zeros(k), u[: order - k, j]] for k in (whole + 1, whole))
        # the older value acts for the first part of the sample, the newer for what is left of it
        older = scipy.linalg.expm(a * step * (1.0 - part)) @ _held(a, b[:, j], step * part)
        drive += np.outer(before, older) + np.outer(now, _held(a, b[:, j], step * (1.0 - part)))
        direct += np.outer(before if part else now, d[:, j])
    values, right = scipy.linalg.eig(state_step)
    if np.linalg.cond(right) < 1e10:
        into, out = np.linalg.solve(right, drive.T.astype(complex)), c @ right
        states = [scipy.signal.lfilter([0.0, 1.0], [1.0, -v], row) for v, row in zip(values, into, strict=True)]
        return (out @ np.array(states)).real.T + direct
    x, y = np.zeros(n), np.empty((order, c.shape[0]))
    for k in range(order):
        y[k] = c @ x
        x = state_step @ x + drive[k]
    return y + direct


def _held(a: Array, b: Array, duration_s: float) -> Array:
    """Return the state (n,) that an input of one leaves after it was held for so long."""
    n = a.shape[0]
    both = np.zeros((n + 1, n + 1))
    both[:n, :n], both[:n, n] = a, b
    return scipy.linalg.expm(both * duration_s)[:n, n]


def _played(kind: Kind, rng: np.random.Generator) -> tuple[Array, int]:
    """Return the input (n, n_u) and its period in rows, 0 for none."""
    n, shape = kind.rows, (kind.rows, kind.inputs)
    if kind.played == "steps":
        return np.repeat(rng.uniform(-1.0, 1.0, size=(n // 20 + 1, kind.inputs)), 20, axis=0)[:n], 0
    if kind.played == "smooth":
        sos = scipy.signal.butter(4, 0.2, output="sos")
        return np.asarray(scipy.signal.sosfilt(sos, rng.normal(size=shape), axis=0)), 0
    if kind.played == "chirp":
        # up and down the band of the modes, four times, the last one held out
        quarter = np.arange(n // 4) / kind.rate_hz
        low, high = 0.5 * kind.band[0] * kind.rate_hz, 2.0 * kind.band[1] * kind.rate_hz
        one = scipy.signal.chirp(quarter, low, quarter[-1], high, method="logarithmic")
        return np.tile(one, 4)[:, None] * np.ones((1, kind.inputs)), 0
    if kind.played == "multisine":
        period = n // 8
        lines = np.zeros((period // 2 + 1, kind.inputs), dtype=complex)
        used = slice(1, int(0.45 * period))
        lines[used] = np.exp(2j * np.pi * rng.uniform(size=lines[used].shape))
        one = np.fft.irfft(lines, period, axis=0)
        return np.tile(one / np.std(one, axis=0), (8, 1)), period
    return rng.normal(size=shape), 0


def _noise(kind: Kind, rng: np.random.Generator) -> Array:
    """Return noise (n, n_y) of unit rms in its colour."""
    white = rng.normal(size=(kind.rows + 1000, kind.outputs))
    if kind.coloured == "drifting":
        white = scipy.signal.lfilter([1.0], [1.0, -0.97], white, axis=0)
    elif kind.coloured == "humming":
        turn = 2.0 * np.pi * rng.uniform(0.02, 0.1)
        hum = scipy.signal.lfilter([1.0], [1.0, -2.0 * 0.98 * np.cos(turn), 0.98**2], white, axis=0)
        white = hum / np.std(hum) + 0.3 * rng.normal(size=white.shape)
    kept = white[1000:]
    return kept / np.std(kept, axis=0)


def maker() -> dict[str, Callable[[int], Record]]:
    """Return what draws each simulated case, by the name of its kind."""
    return {kind.name: partial(drawn, kind) for kind in KINDS}
