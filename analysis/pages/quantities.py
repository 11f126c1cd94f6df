"""Numbers as people read them: two or three digits, the prefix that fits, the unit behind."""

from __future__ import annotations

import math

from analysis.pages.formats import readable, unit_text

PREFIXED = ("rad", "m", "N m", "N", "V", "A", "rad/s", "m/s", "s")
"""Units that carry a prefix."""

LEAST_P = 1e-12
"""Smallest p-value that is stated: so far out no distribution's tail is known."""

LEAST_SHARE = 1e-3
"""Smallest number of percent, and of ppm, that is printed: more zeros behind a point are not read."""

_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))


def scaled(largest: float, unit: str) -> tuple[float, str]:
    """Return (factor, unit) such that `largest` · factor reads between 1 and 1000 where prefixes allow."""
    if unit not in PREFIXED or not math.isfinite(largest) or largest == 0.0:
        return 1.0, unit
    for size, prefix in _PREFIXES:
        if abs(largest) >= 0.9995 * size:
            return 1.0 / size, f"{prefix}{unit}"
    return 1e12, f"p{unit}"


def quantity(value: float, unit: str) -> str:
    """Return a number with three digits and its unit as it is printed."""
    factor, shown = scaled(value, unit)
    return f"{readable(value * factor)} {unit_text(shown)}".strip()


def certainty(probability: float) -> str:
    """Return a probability in whole percent: it is counted in some dozens of cases, and never sure."""
    return f"{min(round(100.0 * probability), 99)} %"


def share(part: float) -> str:
    """Return a part of a whole with three digits: in percent, below 0.001 % in ppm, and below 0.001 ppm as a bound."""
    size, unit = 100.0 * part, "%"
    if not math.isfinite(size) or size == 0.0:
        return f"{size:g} {unit}"
    if abs(size) < LEAST_SHARE:
        size, unit = 1e6 * part, "ppm"
    if abs(size) < LEAST_SHARE:
        return f"below {LEAST_SHARE:g} {unit}"
    return f"{size:.{max(2 - math.floor(math.log10(abs(size))), 0)}f} {unit}"


def span(low: float, high: float, unit: str) -> str:
    """Return "low to high unit" with one prefix for both, and digits enough to distinguish them."""
    largest = max(abs(low), abs(high))
    factor, shown = scaled(largest, unit)
    apart = abs(high - low)
    digits = 3 if apart == 0.0 else min(max(math.ceil(math.log10(largest / apart)) + 2, 3), 9)
    return f"{low * factor:.{digits}g} to {high * factor:.{digits}g} {shown}".strip()


def time_left(left_s: float | None) -> str:
    """Return a remaining time as it is shown."""
    if left_s is None:
        return "not yet known"
    minutes, seconds = divmod(round(left_s), 60)
    return f"{minutes} min {seconds} s" if minutes else f"{seconds} s"


def chance(p: float) -> str:
    """Return a p-value in words; one that is too small for its approximation to hold, as a bound."""
    return "p < 10⁻¹²" if p < LEAST_P else f"p = {readable(p, 2)}"
