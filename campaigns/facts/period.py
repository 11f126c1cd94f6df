"""Whether an input repeats after the stated period: a wrong one gives a response at frequencies never played."""

from __future__ import annotations

import math
from dataclasses import dataclass

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

SAME = 1e-9
"""What two parts of an input may differ by, against its size, and be the same."""

LINES = 20_000
"""Of how many frequencies of an input, the strongest ones, a shift by parts of a sample is found."""

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
        better = _better(parts, claimed, off)
        if better is not None or off > DIFFERENT:
            right = ": take the period out" if better is None else better.words()
            found.append(
                Fact(
                    "period",
                    f"the input does not repeat after {claimed} samples: it differs by {100.0 * off:.2f} % of its rms"
                    f"{right}",
                    "every frequency and every noise computed with it is wrong",
                    segment=segment.label,
                    numbers={"claimed": claimed, "right": 0 if better is None else better.whole, "difference": off},
                    forbids=True,
                    refuses_import=better is not None,
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
    if not best or least >= REPEATS:
        return 0
    return 0 if _shift(parts, best, least) else best


@dataclass(frozen=True)
class _Better:
    """The period of inputs that repeat far better than as claimed; `whole` is 0 where it is not a whole number.

    After it they differ by `least`.
    """

    period: float
    whole: int
    least: float

    def words(self) -> str:
        """Return what to say instead of the claimed period."""
        if not self.whole:
            return f"; its period is {self.period:.2f} samples, not a whole number: take the period out"
        return f"; after {self.whole} it does, to {100.0 * self.least:.2f} %: say period = {self.whole}"


def _better(parts: Array, claimed: int, off: float) -> _Better | None:
    """Return the period of inputs (n, k) that differ by `off` after the `claimed` one, None where that is right."""
    if off <= SAME:
        return None
    best, least = _best(parts, claimed)
    if best == claimed or least >= BETTER * off:
        best, least = claimed, off
    shift = _shift(parts, best, least)
    return _Better(best + shift, 0 if shift else best, least) if shift or best != claimed else None


def _shift(parts: Array, period: int, off: float) -> float:
    """Return by which part of a sample inputs (n, k) shift from period to period, if they differ by `off` for that.

    So does what a generator with a clock of its own plays. What periods differ by is taken for noise, and here it
    would be the input itself.
    """
    if off <= SAME:
        return 0.0
    first = period if parts.shape[0] >= 3 * period else 0
    a, b = parts[first:-period], parts[first + period :]
    window = scipy.signal.windows.hann(a.shape[0])[:, np.newaxis]
    one, other = scipy.fft.rfft(window * a, axis=0), scipy.fft.rfft(window * b, axis=0)
    cross, energy = (np.conj(one) * other).sum(axis=1), 0.5 * (np.abs(one) ** 2 + np.abs(other) ** 2).sum(axis=1)
    strongest = np.argsort(-energy)[:LINES]
    cross, energy = cross[strongest], energy[strongest]
    turn = 2j * np.pi * scipy.fft.rfftfreq(a.shape[0])[strongest]

    def apart(shift: float) -> float:
        """Return what the second part differs by, squared, from the first one a part of a sample later."""
        return float(np.sum(energy - np.real(cross * np.exp(turn * shift))) / np.sum(energy))

    near = min(np.linspace(-1.0, 1.0, 41), key=apart)
    shift = scipy.optimize.minimize_scalar(apart, bounds=(near - 0.05, near + 0.05), method="bounded").x
    return float(shift) if apart(shift) < BETTER**2 * apart(0.0) else 0.0


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
