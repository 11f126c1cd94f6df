"""How often identification finds the delay and the number of modes of drawn benches, whatever drives them.

    python -m benchmarks.identify_delays --seed 12 --cases 24

Benches of one to four light modes between 6 and 320 Hz act a whole number of samples late, zero to six, at 1 kHz under
a zero-order hold. Six seconds are driven by white noise, held levels, a chirp or a repeated multisine; white noise of
0.03 to 3 % is read with the output. A delay counts as found within 0.3 samples. The last line is the score.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from analysis.identification.input_delay import fit_whole_delay, with_delay
from analysis.identification.modal_parameters import Structure
from analysis.identification.timefit import TimeFit, fit_records

Array = NDArray[np.float64]

RATE_HZ, ROWS = 1000.0, 6000
ORDERS = (1, 2, 3, 4, 5, 6)
WITHIN = 0.3
"""Of a sample."""


def drive_of(kind: str, rng: np.random.Generator) -> Array:
    """Return the input (ROWS,) of a kind."""
    t = np.arange(ROWS) / RATE_HZ
    if kind == "multisine":
        lines = np.arange(1, rng.integers(100, 450))
        phase = rng.uniform(0.0, 2.0 * np.pi, (lines.size, 1))
        period = np.sum(np.cos(2.0 * np.pi * lines[:, None] * t[:1000] + phase), axis=0)
        return np.asarray(np.tile(period / np.sqrt(lines.size), ROWS // 1000))
    if kind == "levels":
        return np.repeat(rng.uniform(-1.0, 1.0, ROWS // 20), 20)
    if kind == "white":
        return rng.standard_normal(ROWS)
    return np.asarray(signal.chirp(t, 1.0, t[-1], 300.0))


def bench(modes: int, late: int, u: Array, rng: np.random.Generator) -> Array:
    """Return what a drawn bench of so many modes makes of an input (n,), so many samples later."""
    moved = np.concatenate([np.zeros(late), u[: u.size - late]])
    y = np.zeros(u.size)
    for frequency_hz in np.sort(10.0 ** rng.uniform(0.8, 2.5, modes)):
        ratio, gain = 10.0 ** rng.uniform(-2.3, -1.0), rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-1.0, 0.0)
        omega = 2.0 * np.pi * frequency_hz
        b, a, _ = signal.cont2discrete(
            ([gain * omega**2], [1.0, 2.0 * ratio * omega, omega**2]), 1.0 / RATE_HZ, method="zoh"
        )
        y += signal.lfilter(b[0], a, moved)
    return y


def identified(u: Array, y: Array) -> TimeFit:
    """Return the fit to one input and one output (n,), as `mccd identify` makes it of an imported record."""

    def search(inputs: list[Array], outputs: list[Array]) -> TimeFit:
        return fit_records(inputs, outputs, RATE_HZ, ORDERS, rigid_bodies=None)

    records = [u[:, None]], [y[:, None]]
    fit = fit_whole_delay(search, *records, RATE_HZ, ORDERS, Structure())  # type: ignore[arg-type]
    return with_delay(fit, *records, RATE_HZ)


def main() -> None:
    """Print a line a case, then how many delays and numbers of modes were found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--cases", type=int, default=24)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    delays = counts = 0
    for _ in range(options.cases):
        modes, late = int(rng.integers(1, 5)), int(rng.integers(0, 7))
        kind, level = str(rng.choice(["multisine", "levels", "white", "chirp"])), 10.0 ** rng.uniform(-3.5, -1.5)
        u = drive_of(kind, rng)
        y = bench(modes, late, u, rng)
        began = time.process_time()
        fit = identified(u, y + level * y.std() * rng.standard_normal(y.size))
        found = float(fit.model.delay_s[0]) * RATE_HZ
        delays += abs(found - late) <= WITHIN
        counts += fit.model.n_blocks == modes
        print(
            f"{kind:10} noise {100.0 * level:.3f} %  delay {late} → {found:.2f}  modes {modes} → {fit.model.n_blocks}  "
            f"{time.process_time() - began:.1f} s",
            flush=True,
        )
    print(f"delay found in {delays} of {options.cases}, number of modes in {counts}")


if __name__ == "__main__":
    main()
