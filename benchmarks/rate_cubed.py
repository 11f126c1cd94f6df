"""Does a record hold a force that grows with the cube of the rate? A regression that shares no code with the diagnosis.

    python -m benchmarks.rate_cubed robot-arm.csv --fitted 700

An ARX model (Ljung 1999, section 4.2) predicts each sample of the last column from those before it and from the first
column. The cube of the rate, five samples of it, is added; the rate is the acceleration, integrated with a leak. The
table says by orders how unlikely that help is in noise (F test on the fitted samples), and what is left of the squared
error of one step on the samples after them, which no fit has seen.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

ORDERS = 8, 12, 16, 24, 32
LAGS = 5
LEAK = 0.98


def late(signal: Array, count: int) -> Array:
    """Return the signal (n,) late by 1 to `count` samples, (n, count)."""
    padded = np.concatenate([np.zeros(count), signal])
    return np.stack([padded[count - k : count - k + signal.size] for k in range(1, count + 1)], axis=1)


def compare(u: Array, y: Array, fitted: int, order: int) -> tuple[float, float, float]:
    """Return the one-step error after the fitted samples over the output, the chance, and the part left by the cube."""
    rate = scipy.signal.lfilter([1.0], [1.0, -LEAK], y - y.mean())
    linear = np.concatenate([late(y, order), u[:, None], late(u, order)], axis=1)
    both = np.concatenate([linear, late((rate / rate.std()) ** 3, LAGS)], axis=1)
    rows, unseen = slice(order + 1, fitted), slice(fitted, y.size)
    left = [y - x @ np.linalg.lstsq(x[rows], y[rows], rcond=None)[0] for x in (linear, both)]
    before, after = (float(e[rows] @ e[rows]) for e in left)
    free = fitted - order - 1 - both.shape[1]
    chance = float(scipy.stats.f.sf((before - after) / LAGS / (after / free), LAGS, free))
    plain, helped = (float(e[unseen] @ e[unseen]) for e in left)
    return float(np.sqrt(plain / (y.size - fitted)) / y.std()), chance, helped / plain


def main(arguments: list[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("record", type=Path, help="CSV with a line of names: first column the force, last the response")
    parser.add_argument("--fitted", type=int, required=True, help="samples to fit; those after them are not seen")
    given = parser.parse_args(arguments)
    values = np.genfromtxt(given.record, delimiter=",", skip_header=1)
    print("| order | error of one step | chance of the cube's help in noise | left of it on unseen samples |")
    print("|---|---|---|---|")
    for order in ORDERS:
        error, chance, part = compare(values[:, 0], values[:, -1], given.fitted, order)
        print(f"| {order} | {100.0 * error:.3f} % | {chance:.0e} | {100.0 * part:.0f} % |")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
