"""What an effect may look at when it guesses the scale of its parameters: one channel pair of a record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from sim_backend.effects.over_position import OverPosition
from sim_backend.jit import njit

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_LINES = 32
"""Frequency bins to either side whose median is the level of the noise there."""

_VISIBLE, _FINE, _MOST, _LOOKED_AT, _LEAST_LOOKS, _MOST_LOOKS = 4.0, 0.2, 60_000, 8_000_000, 8, 600
"""Steps of a rounding are searched for from where they move the readings by so many standard deviations, at distances
that shift the input by so much of a step; at most so many are tried, and on so many samples in all looked at closely,
at least so many steps and at most so many."""


DISTANCES = 1024
"""Distances over which a force is compared with itself: from half the range of positions to so small a part of it."""

_REACHES = 1e-6
"""Part of the largest energy of a response, below which that is a rounding error."""

LEAST_PART = 0.25
"""A rounding to a step that is a little off looks like part of the true one; a part smaller than this is not that."""


@njit(fastmath={"reassoc", "contract"})
def _rounding_scores(u, wanted, energy, steps, scores, ratios):  # type: ignore[no-untyped-def]
    """Fill `scores` with by how much rounding levels `u` (n,) to each of `steps` would lower the sum of squares.

    `wanted` (n,) is the slope of that by each level, `energy` (n,) the squared answer to a unit of each; a step that is
    a little off is a part of the true one. `ratios` are filled with by how much any part of either sign would. All
    steps are tried on a stretch of levels while it is in fast memory.
    """
    agreed, size = np.zeros(steps.size), np.zeros(steps.size)
    for first in range(0, u.size, 1024):
        levels, slopes, weights = u[first : first + 1024], wanted[first : first + 1024], energy[first : first + 1024]
        for i in range(steps.size):
            per, own_agreed, own_size = 1.0 / steps[i], 0.0, 0.0
            for k in range(levels.size):
                x = levels[k] * per
                error = np.floor(x + 0.5) - x
                own_agreed += slopes[k] * error
                own_size += weights[k] * error * error
            agreed[i] += own_agreed
            size[i] += own_size
    for i in range(steps.size):
        q = steps[i]
        part = min(max(agreed[i] / max(size[i] * q, 1e-300), LEAST_PART), 1.0)
        ratios[i] = agreed[i] * agreed[i] / max(size[i], 1e-300)
        scores[i] = part * q * (2.0 * agreed[i] - part * q * size[i])


@njit
def _mode_scores(u, r, weight, centres, damping, scores):  # type: ignore[no-untyped-def]
    """Fill `scores` with how well a mode at each of `centres` (in bins) explains `r` by `u`, bins weighed."""
    for k in range(centres.size):
        f = centres[k]
        reach = 12.0 * damping * f + 2.0
        first, last = max(int(np.ceil(f - reach)), 1), min(int(f + reach), u.size - 1)
        size, agreed = 0.0, 0.0
        for i in range(first, last + 1):
            ratio = i / f
            answer = u[i] / complex(1.0 - ratio * ratio, 2.0 * damping * ratio)
            size += weight[i] * (answer.real * answer.real + answer.imag * answer.imag)
            agreed += weight[i] * (answer.real * r[i].real + answer.imag * r[i].imag)
        scores[k] = agreed * agreed / size if size > 0.0 else 0.0


def _squares_of_answers(answer: Array, rows: int) -> Callable[[Array], float]:
    """Return a function that gives the squared answer of the readings to a change (rows,) of the input."""
    n = scipy.fft.next_fast_len(rows, real=True)
    gain = np.sum(np.abs(scipy.fft.rfft(answer[:n], n, axis=0)) ** 2, axis=1)
    gain[1 : (n + 1) // 2] *= 2.0  # each stands for its conjugate too
    return lambda change: float(gain @ np.abs(scipy.fft.rfft(change, n)) ** 2) / n


def _energy_of_levels(answer: Array, levels: Ints) -> Array:
    """Return the squared answer of the readings to a unit of each level of the input, by the samples' `levels` (n,).

    Samples of a stretch that holds one level add up in the answer, stretches apart from each other only in its
    square: that of m samples is the sum of (m - |k|) r(k) over the autocorrelation r of the answer to one.
    """
    n = answer.shape[0]
    alike = np.fft.irfft(np.sum(np.abs(np.fft.rfft(answer, 2 * n, axis=0)) ** 2, axis=1))[:n]
    # second sums: S(m + 1) - S(m) = r(0) + 2 (r(1) + … + r(m))
    energy = np.concatenate([[0.0], np.cumsum(2.0 * np.cumsum(alike) - alike[0])])
    ends = np.append(np.flatnonzero(np.diff(levels)) + 1, levels.size)
    held = np.diff(ends, prepend=0)
    whole = energy[np.minimum(held, n)] * np.maximum(held / n, 1.0)
    return np.asarray(np.bincount(levels[ends - 1], whole), dtype=float)


@dataclass(frozen=True)
class RecordView:
    """The signals at one location: input `u`, motion `position` and `rate`, each (n,), and the model's residual (n,).

    `temperature_k` is (n,) or None when the record has no temperature channel; `lowest_mode_hz` is the first resonance
    of the nominal model at this location (0 for a rigid body). `wanted` (n,), where known, is by how much the
    likelihood would rise per unit of a small change of each sample of the input, and `answer` (rows, n_y) what a change
    by one unit of a single sample makes of the readings, in standard deviations of their noise. `ends` are the samples
    at which the runs end that are joined here. `sensed` (n,), where known, is the position by the model alone: what of
    the residual is motion is not in it, and neither is what is an error of the reading.
    """

    rate_hz: float
    u: Array
    position: Array
    rate: Array
    residual: Array
    temperature_k: Array | None
    lowest_mode_hz: float
    wanted: Array | None = None
    answer: Array | None = None
    ends: tuple[int, ...] = ()
    sensed: Array | None = None

    @property
    def seen(self) -> float:
        """By how many standard deviations of noise a change by one unit of a single sample moves all readings."""
        return 0.0 if self.answer is None else float(np.linalg.norm(self.answer))

    @property
    def u_peak(self) -> float:
        """Largest magnitude of the input."""
        return float(np.max(np.abs(self.u), initial=0.0))

    @property
    def position_peak(self) -> float:
        """Largest magnitude of the position."""
        return float(np.max(np.abs(self.position), initial=0.0))

    @property
    def position_range(self) -> float:
        """Distance between the outermost positions."""
        return float(np.ptp(self.position)) if self.position.size else 0.0

    @property
    def swing(self) -> float:
        """Half the distance between the outermost positions: how far the motion goes to either side of its middle."""
        return 0.5 * self.position_range

    @property
    def position_spread(self) -> float:
        """Distance within which the position is for nine tenths of the time."""
        return float(np.ptp(np.quantile(self.position, [0.05, 0.95]))) if self.position.size else 0.0

    @property
    def rate_peak(self) -> float:
        """Largest magnitude of the rate."""
        return float(np.max(np.abs(self.rate), initial=0.0))

    @property
    def duration_s(self) -> float:
        """Length of the record."""
        return self.u.size / self.rate_hz

    def rounding_steps(self) -> Array:
        """Return every step (n,) of a rounding of the input that differs enough from its neighbours, ascending."""
        moving = self.u[self.wanted != 0.0] if self.wanted is not None else self.u[:0]
        size = float(np.sqrt(np.mean(moving**2))) if moving.size else 0.0
        if not (size > 0.0 and self.seen > 0.0):
            return np.zeros(0)
        # rounding to a step q adds an error of q²/12 to each sample
        low = max(_VISIBLE * np.sqrt(12.0 / moving.size) / self.seen, size / (_FINE * _MOST))
        # at a distance of _FINE q²/size an input of this size is shifted relative to its quantisation grid by _FINE
        # steps
        count = int(max((1.0 / low - 4.0 / self.u_peak) * size / _FINE, 0.0))
        return np.asarray(1.0 / (1.0 / low - np.arange(count) * _FINE / size))

    def likely_roundings(self, n: int) -> list[float]:
        """Return the `n` steps of a rounding of the input that the residual speaks for most."""
        return [step for _, step in self._roundings[0][:n]]

    def rounding_choices(self) -> float:
        """Return among how many steps of a rounding the likeliest was found, as noise alone would have to be asked.

        What no noise has, any rounding takes a part of by chance: where the usual step explains s times what it does of
        noise, so does the best of n, and what it explains, g, is n exp(-g / 2s) likely by chance, not n exp(-g / 2).
        """
        found, louder = self._roundings
        count = float(max(self.rounding_steps().size, 1))
        best = found[0][0] if found else 0.0
        return count * float(np.exp(min(0.5 * max(best, 0.0) * (1.0 - 1.0 / louder), 600.0)))

    @cached_property
    def _roundings(self) -> tuple[list[tuple[float, float]], float]:
        """What a rounding of the input to a step explains, with the step, most first; and how loud the noise is."""
        steps = self.rounding_steps()
        if not steps.size or self.wanted is None or self.answer is None:
            return [], 1.0
        used = self.wanted != 0.0
        # commands are held and played again: each level needs to be rounded once
        u, levels = np.unique(self.u[used], return_inverse=True)
        wanted, energy = np.bincount(levels, self.wanted[used]), _energy_of_levels(self.answer, levels)
        size = float(np.sqrt(np.mean(u**2)))

        def scores(steps: Array) -> tuple[Array, Array]:
            out, ratios = np.empty(steps.size), np.empty(steps.size)
            _rounding_scores(u, wanted, energy, steps, out, ratios)
            return out, ratios

        coarse, ratios = scores(steps)
        # of steps that have nothing to do with the residual half explain less than the median of one squared deviation
        louder = max(float(np.median(ratios)) / float(scipy.special.chdtri(1, 0.5)), 1.0)
        sums = _squares_of_answers(self.answer, self.u.size)
        found: list[tuple[float, float]] = []
        # between two steps of the grid a large command is shifted by half of one, and errors of levels that a slow
        # command passes through are alike: many are looked at closely
        for _ in range(min(max(_LOOKED_AT // self.u.size, _LEAST_LOOKS), _MOST_LOOKS, steps.size)):
            i = int(np.argmax(coarse))
            if not np.isfinite(coarse[i]):
                break  # all have been looked at
            near = 1.0 / (1.0 / steps[i] + np.linspace(-1.0, 1.0, 21) * _FINE / size)
            step = float(near[int(np.argmax(scores(near)[0]))])
            error = np.where(used, step * np.floor(self.u / step + 0.5) - self.u, 0.0)
            agreed, moved = float(error @ self.wanted), sums(error)
            part = min(max(agreed / max(moved, 1e-300), LEAST_PART), 1.0)
            found.append((part * (2.0 * agreed - part * moved), step))
            coarse[max(0, i - 2) : i + 3] = -np.inf
        return sorted(found, reverse=True), louder

    def residual_lines_hz(self, n: int, above_hz: float = 0.0, bands: int = 64) -> list[float]:
        """Return the `n` frequencies above a lowest at which the residual's spectrum is highest over its surroundings.

        These reach to either side by one of so many `bands` that make the whole spectrum (the more, the narrower must
        be a peak), and by enough bins of a run to know their median. A free-running disturbance has another phase in
        every run, so the spectra of runs are added without their phases, each in units of its own surroundings.
        """
        size = self.residual.size
        excess = np.zeros(size // 2 + 1)
        if excess.size < 32:
            return []
        ends = self.ends or (size,)
        for start, stop in zip((0, *ends[:-1]), ends, strict=True):
            width = max(excess.size // bands, min(_LINES * size // (stop - start), excess.size // 16), 8)
            power = np.abs(np.fft.rfft(self.residual[start:stop] * np.hanning(stop - start), size)) ** 2
            floor = np.array([np.median(power[max(0, i - width) : i + width]) for i in range(0, power.size, width)])
            excess += power / np.maximum(np.repeat(floor, width)[: power.size], np.finfo(float).tiny)
        excess[: max(2, int(np.ceil(above_hz * size / self.rate_hz)))] = 0.0
        # a vibration line is as wide as the frequency bins of a run of median length
        beside = 3 * max(round(size / float(np.median(np.diff((0, *ends))))), 1)
        lines: list[float] = []
        for _ in range(n):
            i = int(np.argmax(excess))
            lines.append(i * self.rate_hz / size)
            excess[max(0, i - beside) : i + beside + 1] = 0.0
        return lines

    def modulations(self, signal: Array) -> Array:
        """Return what a torque explains, `signal` (n,) times an oscillating gain, at each frequency (n // 2 + 1,).

        Frequencies go up to half the sample rate; each run has its own phase. What a torque explains (twice a
        log-likelihood ratio) is its inner product with `wanted`, squared, over the energy of its response. The first
        is the spectrum of a product, the second that of a product of two autocorrelations.
        """
        size = signal.size
        found = np.zeros(size // 2 + 1)
        if self.wanted is None or self.answer is None or not np.any(self.wanted):
            return found
        rows = scipy.fft.next_fast_len(2 * self.answer.shape[0], real=True)
        answer = np.zeros(size)
        alike = scipy.fft.irfft(np.sum(np.abs(scipy.fft.rfft(self.answer, rows, axis=0)) ** 2, axis=1), rows)
        known = min(self.answer.shape[0], size)
        answer[:known] = alike[:known]
        ends = self.ends or (size,)
        for start, stop in zip((0, *ends[:-1]), ends, strict=True):
            wanted, n = self.wanted[start:stop], stop - start
            acting = np.where(wanted != 0.0, signal[start:stop], 0.0)
            rows = scipy.fft.next_fast_len(2 * n, real=True)
            both = scipy.fft.irfft(np.abs(scipy.fft.rfft(acting, rows)) ** 2, rows)[:n] * answer[:n]
            energy = 2.0 * np.fft.rfft(both, size).real - both[0]
            agreed = 2.0 * np.abs(np.fft.rfft(wanted * acting, size)) ** 2
            # a response that is nearly zero would explain rounding errors
            found += np.where(energy > _REACHES * np.max(energy), agreed / np.maximum(energy, 1e-300), 0.0)
        return found

    def line_phases(self, frequency_hz: float) -> list[tuple[float, float]]:
        """Return, for each run, the phase of the residual's line in periods, in the middle of the run, and its seconds.

        In the middle, because a small error of the frequency shifts the phase there least. Samples that no fit may use
        (`wanted` is zero) take no part.
        """
        ends = self.ends or (self.residual.size,)
        found = []
        for start, stop in zip((0, *ends[:-1]), ends, strict=True):
            rows = stop - start
            used = np.ones(rows) if self.wanted is None else (self.wanted[start:stop] != 0.0).astype(float)
            at = np.arange(rows) - 0.5 * rows
            turning = np.exp(-2j * np.pi * frequency_hz / self.rate_hz * at)
            line = np.sum(np.hanning(rows) * used * self.residual[start:stop] * turning)
            found.append((float(np.angle(line)) / (2.0 * np.pi), rows / self.rate_hz))
        return found

    def likely_modes(self, n: int, damping_ratios: tuple[float, ...]) -> list[tuple[float, float]]:
        """Return the `n` pairs (frequency in Hz, damping ratio) of a further mode with most evidence in the residual.

        Each is a matched filter: the response of a mode to the input, bins weighed by the residual's level around them.
        A mode responds in many bins at once, none of which need be above the noise alone.
        """
        rows = self.residual.size
        lines = np.fft.rfftfreq(rows, 1.0 / self.rate_hz)
        if lines.size < 64 or not self.u_peak > 0.0:
            return []
        r, u = np.fft.rfft(self.residual - self.residual.mean()), np.fft.rfft(self.u)
        width = max(lines.size // 256, 8)
        level = np.array([np.median(np.abs(r[max(0, i - width) : i + width])) for i in range(0, lines.size, width)])
        weight = 1.0 / np.maximum(np.repeat(level, width)[: lines.size], np.finfo(float).tiny) ** 2
        low = max(lines[8], self.lowest_mode_hz / 30.0)
        found: list[tuple[float, float, float]] = []
        for damping in damping_ratios:
            # at steps of one damping ratio a neighbour's answer still agrees with a mode's own to three quarters
            grid = np.exp(np.arange(np.log(low), np.log(0.45 * self.rate_hz), damping))
            scores = np.empty(grid.size)
            _mode_scores(u, r, weight, grid / lines[1], damping, scores)
            found += zip(scores.tolist(), grid.tolist(), [damping] * grid.size, strict=True)
        modes: list[tuple[float, float]] = []
        for _, f, damping in sorted(found, reverse=True):
            if len(modes) == n:
                break
            if all(abs(f / g - 1.0) > 4.0 * max(damping, z) for g, z in modes):
                modes.append((f, damping))
        return modes

    def force_periods(self, n: int) -> list[float]:
        """Return the `n` distances (output unit) after which a force that repeats over the position is most likely to.

        Each is a matched filter: the gain of a small force is its inner product with `wanted`, squared, over the energy
        that it leaves in the readings. The plant stands between force and residual, so that in fast motion the residual
        itself does not repeat. Found are distances from half the range of positions to a 1024th of it, the best of
        every half octave.
        """
        width = self.position_range
        if self.wanted is None or self.answer is None or not np.any(self.wanted) or not width > 0.0:
            return []
        bins = np.minimum(((self.position - np.min(self.position)) / width * 4096).astype(np.int64), 4095)
        agreed = np.abs(np.fft.rfft(np.bincount(bins, weights=self.wanted, minlength=4096), 4 * 4096))[: 4 * DISTANCES]
        edges = np.unique(np.geomspace(8, agreed.size, 15).astype(int))
        distances = [
            width * 4.0 / (a + int(np.argmax(agreed[a:b]))) for a, b in zip(edges[:-1], edges[1:], strict=True)
        ]
        power = np.sum(np.abs(np.fft.rfft(self.answer, self.wanted.size, axis=0)) ** 2, axis=1) / self.wanted.size
        scores = []
        for distance in distances:
            angle = 2.0 * np.pi / distance * self.position
            waves = np.stack([np.cos(angle), np.sin(angle)]) * (self.wanted != 0.0)
            lines = np.fft.rfft(waves, axis=1)
            product = waves @ self.wanted
            # a spectrum's positive half holds half of the energy
            energy = 2.0 * (lines * power @ lines.conj().T).real
            scores.append(float(product @ np.linalg.lstsq(energy, product, rcond=1e-9)[0]))
        return [distances[k] for k in np.argsort(scores)[::-1][:n]]

    def residual_periods(self, n: int) -> list[float]:
        """Return the `n` distances (output unit) after which the residual repeats most over the position.

        As many more over the position by the model alone, where that is known: if the noise is slow, the other has
        noise of many fine distances. Empty when the position does not move.
        """
        return [distance for over in self._over_positions for distance in over.periods(n)]

    def rounding_distances(self, n: int) -> list[float]:
        """Return, near each of the `residual_periods`, the step of a rounding that the residual resembles most."""
        return [step for over in self._over_positions for step in over.steps(n)]

    @cached_property
    def _over_positions(self) -> list[OverPosition]:
        positions = [self.position] if self.sensed is None else [self.position, self.sensed]
        return [over for x in positions if (over := OverPosition.of(x, self.residual)) is not None]
