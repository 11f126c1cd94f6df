"""Quantised numbers: their step, and the resolution of numbers that were written with so many digits.

All differences of quantised numbers are multiples of one step, within the rounding of floating-point numbers, or of
the text that they were written as. Of other numbers each would have to fall within that rounding of a multiple by
chance. Numbers of so many digits, and of so many bits, have steps that grow with them: only the largest have one
common step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sim_backend.linear import Array

_ROUNDING = 4.0
"""A reading is known to so many units of its last digit: it was rounded, scaled to SI units, and subtracted."""

_PARTS = (1, 2, 3)
"""The smallest difference seen may be more than one step where few readings lie on many steps."""

_COARSE = 0.1
"""Numbers are not quantised when their last digit is more than this part of the step: every float is a multiple."""

_LOG_CHANCE = math.log(1e-12)
"""Logarithm of the chance above which numbers may be multiples of a step at random."""


@dataclass(frozen=True)
class Lattice:
    """A quantisation step, its standard deviation, and the natural logarithm of the chance of one at random."""

    step: float
    std: float
    log_p: float


def lattice_of(values: Array) -> Lattice | None:
    """Return the quantisation of all `values` (n,); None when there is none."""
    seen = np.unique(values)
    if seen.size < 4:
        return None
    rounding = _ROUNDING * float(np.finfo(float).eps) * float(np.max(np.abs(seen)))
    seen = np.concatenate([seen[:1], seen[1:][np.diff(seen) > rounding]])
    for part in _PARTS if seen.size > 3 else ():
        found = _with_step(seen, float(np.diff(seen).min()) / part, rounding)
        if found is not None:
            return found
    return None


def _with_step(seen: Array, step: float, rounding: float) -> Lattice | None:
    """Return the quantisation of about this `step` of all of `seen` (k,), ascending."""
    if rounding > _COARSE * step:
        return None
    gaps = np.diff(seen)
    count = float(np.rint(gaps / step).sum())
    # the smallest gap is known to its rounding, the whole span to as much, over many more steps
    exact = float(seen[-1] - seen[0]) / count
    # what text has rounded away nobody has written down: it is how far the numbers are off, if they are off little
    off = max(rounding, float(np.max(np.abs(gaps / exact - np.rint(gaps / exact)))) * exact)
    log_p = (gaps.size - 1) * math.log(2.0 * off / exact)
    return Lattice(exact, off / count, log_p) if off < _COARSE * exact and log_p < _LOG_CHANCE else None


_MOST_DIGITS = 10
"""Numbers with more digits show nothing of it that a diagnosis could see."""

_ANGLES = (1.0, math.pi / 180.0, math.pi / 648_000.0)
"""Units in which numbers may have been written: their own, degrees and seconds of arc."""

_POWERS = 10.0 ** np.arange(-9, 10)
"""Prefixes of such units; what they change in a number's digits is where its point is."""

_SMALL, _FINER = 0.05, 0.5
"""Part of the largest number below which decimal steps are a tenth at most, and the part of such numbers that may be
multiples of the step of the largest: a tenth of them are by chance."""

_PROBED = 1000
"""About so many of the numbers tell at once that they have all digits, as most do."""


def last_place(values: Array) -> float:
    """Return the step of the largest of `values` (n,) where small ones come in finer steps; zero where they do not.

    So it is of numbers that were written with so many digits, or as 32-bit numbers.
    """
    few = values[:: values.size // _PROBED + 1]
    if not np.any(values) or (few.size < values.size and not last_place(few)):
        return 0.0
    # numbers near the ends of the range of floats are no whole multiples of anything, and need no warning
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        decimal = max(_of_few_digits(values / unit) * unit for unit in _ANGLES)
        binary = max(_of_single_precision(values / unit) * unit for unit in np.outer(_ANGLES, _POWERS).ravel())
    return float(max(decimal, binary))


def _of_few_digits(written: Array) -> float:
    size = np.abs(written)
    decade = np.floor(np.log10(np.where(size > 0.0, size, 1.0)))
    for digits in range(1, _MOST_DIGITS + 1):
        # a power of ten below one is not exact, its inverse is
        shift = digits - 1 - decade
        up, down = 10.0 ** np.maximum(shift, 0.0), 10.0 ** np.maximum(-shift, 0.0)
        if _same(written, np.rint(written * up / down) * down / up):
            step = 10.0 ** float(np.max(decade[size > 0.0]) - digits + 1)
            small = written[size < _SMALL * np.max(size)]
            off = np.abs(small / step - np.rint(small / step))
            return step if small.size and float(np.mean(off < _COARSE)) < _FINER else 0.0
    return 0.0


def _of_single_precision(written: Array) -> float:
    short = written.astype(np.float32)
    return float(np.spacing(np.max(np.abs(short)))) if _same(written, short.astype(float)) else 0.0


def _same(written: Array, other: Array) -> bool:
    return bool(np.all(np.abs(written - other) <= _ROUNDING * np.finfo(float).eps * np.abs(written)))
