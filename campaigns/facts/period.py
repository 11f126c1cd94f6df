"""Whether an input repeats after the stated period: a wrong one gives a response at frequencies never played."""

from __future__ import annotations

import math

import numpy as np
import scipy

from campaigns.facts.base import Array, Fact, Seen
from campaigns.log.schema import LogSegment

FOREIGN = 0.5
"""What two parts of an input differ by, against its size, before a later one counts as a repetition: a slow signal is
like itself a few samples later."""

BETTER = 1.0 / 3.0
"""A period that leaves so much less of the input is the right one."""

REPEATS = 0.02
"""What two parts of an input may differ by, against its size, where nobody has said that it repeats."""

DIFFERENT = 0.9
"""What two parts of an input differ by, against its size, from which on it does not repeat at all. The input of a loop
follows the noise as well."""


def facts(seen: Seen) -> list[Fact]:
    """Return for every period that is claimed whether the inputs, or the references of a loop, repeat after it."""
    found: list[Fact] = []
    told: set[int] = set()
    played = _moving(seen.of_role("reference")) or _moving(seen.of_role("input"))
    for segment in seen.segments:
        claimed = claimed_period(segment)
        if claimed < 2 or segment.rows < 2 * claimed or not played or "frequency_hz" in segment.settings:
            continue
        parts = np.stack([values[segment.start : segment.stop] for values in played.values()], axis=1)
        size = parts.std(axis=0)
        if not np.any(size > 0.0):
            continue
        parts = parts[:, size > 0.0] / size[size > 0.0]
        off = difference(parts, claimed)
        best, least = claimed, off
        if off > 1e-9:
            best, least = _best(parts, claimed)
        wrong = best != claimed and least < BETTER * off
        if wrong or off > DIFFERENT:
            right = ": take the period out"
            if wrong:
                right = f"; after {best} it does, to {100.0 * least:.2f} %: say period = {best}"
            found.append(
                Fact(
                    "period",
                    f"the input does not repeat after {claimed} samples: it differs by {100.0 * off:.2f} % of its rms"
                    f"{right}",
                    "every frequency and every noise computed with it is wrong",
                    segment=segment.label,
                    numbers={"claimed": claimed, "right": best if wrong else 0, "difference": off},
                    forbids=True,
                    refuses_import=wrong,
                )
            )
        elif claimed not in told:
            told.add(claimed)
            text = f"the input repeats after {claimed} samples, to {100.0 * off:.2f} % of its rms"
            found.append(Fact("period", text, segment=segment.label, numbers={"claimed": claimed}, remark=False))
    return found


def period_of(inputs: dict[str, Array]) -> int:
    """Return the number of samples after which the inputs (n,) repeat nearly exactly, 0 where they do not."""
    moving = _moving(inputs)
    if not moving:
        return 0
    parts = np.stack([values / values.std() for values in moving.values()], axis=1)
    best, least = _best(parts, 0)
    return best if best and least < REPEATS else 0


def claimed_period(segment: LogSegment) -> int:
    """Return the samples after which a segment says that it repeats, 0 where it says nothing."""
    value = segment.settings.get("period_samples")
    return int(value) if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value) else 0


def _moving(columns: dict[str, Array]) -> dict[str, Array]:
    return {name: values for name, values in columns.items() if np.ptp(values) > 0.0}


def difference(parts: Array, period: int) -> float:
    """Return the rms by which inputs (n, k) of size one differ after `period` samples, 1 for inputs that are foreign.

    The first period may contain the transient: it is left out where there are three.
    """
    first = period if parts.shape[0] >= 3 * period else 0
    apart = parts[first + period :] - parts[first:-period]
    return float(np.sqrt(np.mean(apart**2) / 2.0))


def _best(parts: Array, claimed: int) -> tuple[int, float]:
    """Return the shortest period after which inputs (n, k) repeat about best, and what they differ by."""
    n = parts.shape[0]
    periods = np.arange(1, n // 2 + 1)
    # |x(n+p) - x(n)|² summed is two energies less twice the autocorrelation, which one transform gives for every p
    spectrum = np.abs(scipy.fft.rfft(parts, scipy.fft.next_fast_len(2 * n), axis=0)) ** 2
    alike = scipy.fft.irfft(spectrum, scipy.fft.next_fast_len(2 * n), axis=0)[periods].sum(axis=1)
    energy = np.concatenate([[0.0], np.cumsum((parts**2).sum(axis=1))])
    apart = (energy[n - periods] + energy[n] - energy[periods] - 2.0 * alike) / (n - periods)
    share = np.sqrt(np.maximum(apart / (2.0 * parts.shape[1]), 0.0))
    foreign = np.flatnonzero(share > FOREIGN)
    if foreign.size == 0 or foreign[0] == share.size - 1:
        return claimed, difference(parts, claimed) if claimed else 1.0
    later = share[foreign[0] :]
    near = int(periods[foreign[0] :][np.argmax(later <= 1.5 * later.min() + 1e-6)])
    # rounding may exchange neighbours
    best = min(range(max(near - 2, 2), min(near + 2, n // 2) + 1), key=lambda p: difference(parts, p))
    return best, difference(parts, best)
