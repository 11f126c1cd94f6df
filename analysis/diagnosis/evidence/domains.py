"""Where the residual is above the noise: frequency, amplitude, position, direction, rate, time, temperature, axis.

All of it is judged on whitened residuals, which noise alone makes independent numbers of unit variance; slow noise that
the filter is too short for is divided out (`slow_noise`). A curve shows the residual's rms in units of that noise, so 1
is the noise floor in every domain. Of frequency see `spectra`. Elsewhere there are two tests: is the residual larger in
some bin than noise makes it (F test of the largest ratio, corrected for the number of bins), and does its mean follow
the bins, or that of a missing force (generalised least squares on indicators of the bins, as they are and passed
through the plant, F tests)? Twice the smaller of the two p-values counts.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.diagnosis.evidence.bins import Binned, accumulate, binned, largest_test, mean_test, moving_rms, rate_of
from analysis.diagnosis.evidence.slow_noise import (
    cosine_rows,
    excess_of_indicators,
    first_of_fast,
    levelled,
    low_levels,
)
from analysis.diagnosis.evidence.spectra import Repeat, bands, coherence_test, explained_by_shifts, repeat_test
from analysis.diagnosis.noise.levels import BAND_ROWS
from analysis.diagnosis.noise.whitener import Whitener, filtered
from analysis.diagnosis.nominal.responses import response
from analysis.diagnosis.records.dataset import WARMING_K, Dataset, Record
from analysis.diagnosis.result import Domain
from analysis.diagnosis.side_by_side import side_by_side
from analysis.diagnosis.tails import f_tail
from analysis.pages.quantities import span
from sim_backend.linear import Array, DiscreteModel, discretise
from sim_backend.model import Model, Port

_DOMAINS = "frequency", "amplitude", "position", "direction", "rate", "time", "temperature", "cross-axis"

AT_REST = 1e-2
"""Rates below this part of their rms have no direction."""

TIME_BINS = 40

FORCE_BINS = 10
"""Most bins of a missing force: each costs a simulation, and a law of force is smooth."""


@dataclass(frozen=True)
class Force:
    """How a force on an output's own degree of freedom acts on it: the plant, the input and the output by number."""

    plant: DiscreteModel
    input: int
    output: int


@dataclass(frozen=True)
class _Series:
    """One output of one run, all its records joined: whitened residual `w` (n,) and what it may depend on.

    `noise_rows` is the number of samples from which the noise's size is known; 0 when it was taken from the residual
    itself. `w` is divided by the `levels` of each part's lowest cosine coefficients, and `weighed` (n,) by them once
    more, for products with columns that are whitened only.
    """

    run: str
    port: Port
    w: Array
    weighed: Array
    u: Array
    parts: tuple[int, ...]
    levels: tuple[Array, ...]
    repeats: tuple[Repeat, ...]
    position: Array
    rate: Array
    amplitude: Array
    time_s: Array
    temperature_k: Array | None
    taps: Array
    noise_rows: int
    rate_hz: float
    force: Force | None


def evidence(
    data: Dataset, residuals: Sequence[Array], whitener: Whitener, model: Model, *, workers: int = 2
) -> dict[str, tuple[Domain, ...]]:
    """Return every curve by domain, one per run and output; `residuals` (n, n_y) belong to the records of `data`.

    `model` gives the outputs' names and units. A domain that no run can show (temperature, say) is empty.
    """
    rows = data.noise_rows if whitener.repeats else 0
    plant = discretise(model.linear(), data.rate_hz)
    shown: list[tuple[int, list[_Series]]] = []
    for run in dict.fromkeys(r.name for r in data.records):
        pairs = [
            (r, e)
            for r, e in zip(data.records, residuals, strict=True)
            if r.name == run and r.n > 2 * whitener.order + 8
        ]
        if not pairs:
            continue
        joined = [
            _series(run, pairs, o, port, whitener, rows, data.rate_hz, _force(plant, o, model))
            for o, port in enumerate(model.outputs)
        ]
        shown += [(o, joined) for o in range(len(joined))]
    curves = [curve for found in side_by_side(lambda at: _curves(*at), shown, workers=workers) for curve in found]
    return {name: tuple(curve for domain, curve in curves if domain == name) for name in _DOMAINS}


def _curves(o: int, joined: list[_Series]) -> list[tuple[str, Domain]]:
    """Return the curves of output `o` of one run, each with its domain."""
    s = joined[o]
    out = [("frequency", _frequency(s)), ("time", _along(s, s.time_s, "s", "", TIME_BINS, slow=True, free_mean=True))]
    for name, values, per in (("position", s.position, ""), ("rate", s.rate, "/s"), ("amplitude", s.amplitude, "")):
        if np.ptp(values) > 0.0:
            out.append((name, _along(s, values, f"{s.port.unit}{per}", name)))
    if np.any(s.rate != 0.0):
        out.append(("direction", _direction(s)))
    if s.temperature_k is not None and np.ptp(s.temperature_k) > WARMING_K:
        out.append(("temperature", _along(s, s.temperature_k, "K", "temperature", slow=True)))
    if len(joined) > 1:
        out.append(("cross-axis", _cross_axis(o, joined)))
    return out


def _force(plant: DiscreteModel, o: int, model: Model) -> Force | None:
    dofs = [p.dof for p in model.inputs]
    own = model.outputs[o].dof
    return Force(plant, dofs.index(own), o) if own in dofs and plant.a.shape[0] else None


def _series(
    run: str,
    pairs: Sequence[tuple[Record, Array]],
    o: int,
    port: Port,
    whitener: Whitener,
    rows: int,
    rate_hz: float,
    force: Force | None,
) -> _Series:
    # the whitening filter starts from zeros, so its first samples are not white
    cuts = [slice(first_of_fast(r.n, whitener.order), None) for r, _ in pairs]
    white = [
        whitener.apply(np.ascontiguousarray(e[:, o : o + 1]), o)[cut, 0]
        for (_, e), cut in zip(pairs, cuts, strict=True)
    ]
    levels = tuple(low_levels(whitener, x.size, o) for x in white)
    w = [levelled(*one) for one in zip(white, levels, strict=True)]

    def joined(parts: Iterable[Array]) -> Array:
        return np.concatenate([x[cut] for x, cut in zip(parts, cuts, strict=True)])

    # what the model says the motion was: the measured one would carry the noise into the choice of the bin
    moved = [r.y[:, o] - e[:, o] for r, e in pairs]
    length = max(int(rate_hz / 20.0), 16)
    begin = np.concatenate([[0], np.cumsum([r.n for r, _ in pairs])[:-1]])
    warm = all(r.temperature_k is not None for r, _ in pairs)
    return _Series(
        run=run,
        port=port,
        w=np.concatenate(w),
        weighed=np.concatenate([levelled(*one) for one in zip(w, levels, strict=True)]),
        u=joined(r.u for r, _ in pairs),
        parts=tuple(x.size for x in w),
        levels=levels,
        repeats=tuple(_repeats([r for r, _ in pairs], [cut.start for cut in cuts])),
        position=joined(moved),
        rate=joined(rate_of(x, rate_hz) for x in moved),
        amplitude=joined(moving_rms(x, length) for x in moved),
        time_s=joined((b + np.arange(r.n)) / rate_hz for b, (r, _) in zip(begin, pairs, strict=True)),
        temperature_k=joined(r.temperature_k for r, _ in pairs if r.temperature_k is not None) if warm else None,
        taps=whitener.taps[o],
        noise_rows=rows,
        rate_hz=rate_hz,
        force=force,
    )


def _repeats(records: Sequence[Record], missing: Sequence[int]) -> Iterator[Repeat]:
    """Yield the repeated periods of the joined samples, of which so many are `missing` at the start of each record."""
    at = 0
    for record, lost in zip(records, missing, strict=True):
        for w in record.windows:
            whole = (w.stop - w.start) // w.period if w.period else 0
            # the first of several contains the end of the transient, and perhaps the samples that are lost
            first = 1 if whole >= 3 or w.start < lost else 0
            if whole - first >= 2:
                yield Repeat(at + w.start - lost + first * w.period, w.period, whole - first)
        at += record.n - lost


def _energy_test(mean_square: Array, dof: Array, noise_rows: int) -> float:
    """Return the p-value of the largest bin: F against the noise's own samples, or against the other bins."""
    total, all_dof = float(mean_square @ dof), float(dof.sum())
    if noise_rows:
        return largest_test(mean_square, dof, np.full(dof.size, float(noise_rows)))
    other = np.maximum(all_dof - dof, 1.0)
    ratio = mean_square / np.maximum((total - mean_square * dof) / other, np.finfo(float).tiny)
    return largest_test(ratio, dof, other)


def _both(energy: float, mean: float) -> float:
    return min(1.0, 2.0 * min(energy, mean))


def _along(
    s: _Series,
    values: Array,
    unit: str,
    name: str,
    most: int = 24,
    *,
    slow: bool = False,
    free_mean: bool = False,
) -> Domain:
    """Return the curve along a covariate (n,), in bins of equal numbers of samples.

    A `slow` covariate lies in the lowest cosine coefficients, where the noise is known from a dozen numbers.
    """
    found = binned(values, s.w, most)
    energy = _energy_test(found.mean_square, found.count.astype(float), s.noise_rows)
    rows = min(s.noise_rows, BAND_ROWS) if slow and any(one.size for one in s.levels) else s.noise_rows
    mean = _mean_p(s, values, found, rows, free_mean=free_mean)
    i = int(np.argmax(found.mean_square))
    low, high = found.edges[i], found.edges[i + 1]
    what = f"{s.port.dof} at {name} {span(low, high, unit)}" if name else f"{s.port.dof} from {span(low, high, unit)}"
    return _domain(s, found.centre, unit, np.sqrt(found.mean_square), _both(energy, mean), what)


def _mean_p(s: _Series, values: Array, found: Binned, noise_rows: int, *, free_mean: bool = False) -> float:
    """Return the p-value of "no mean follows the bins": neither of the reading itself nor of a force on the structure.

    An error of the sensor is a curve of the reading; a missing force is a curve too, but of the force, and acts on the
    reading through the plant. The noise is known from `noise_rows`.
    """
    parts = np.concatenate([[0], np.cumsum(s.parts)])
    total = float(s.w @ s.w)
    gram, cross = accumulate(s.taps, found.index, s.weighed, parts, found.count.size)
    for (a, b), levels in zip(itertools.pairwise(parts), s.levels, strict=True):
        if levels.size:
            gram -= excess_of_indicators(s.taps, found.index[a:b], found.count.size, levels)
    reading = mean_test(gram, cross, total, s.w.size, noise_rows, free_mean=free_mean)
    if s.force is None:
        return reading
    coarse = binned(values, s.w, FORCE_BINS) if found.count.size > FORCE_BINS else found
    gram, cross = _through_plant(s, s.force, coarse, parts)
    return _both(reading, mean_test(gram, cross, total, s.w.size, noise_rows, free_mean=free_mean))


def _through_plant(s: _Series, force: Force, found: Binned, parts: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return the normal equations of a unit force in each bin, passed through the plant and whitened."""
    n = found.count.size
    gram, cross = np.zeros((n, n)), np.zeros(n)
    for (a, b), levels in zip(itertools.pairwise(parts), s.levels, strict=True):
        moved = np.empty((n, b - a))
        for k in range(n):
            acting = (found.index[a:b] == k).astype(float)
            moved[k] = response(force.plant, acting, force.input)[:, force.output]
        columns, left = filtered(s.taps, moved), s.w[a:b]
        if levels.size:
            columns, left = cosine_rows(columns, levels), scipy.fft.dct(left, norm="ortho")
        gram += columns @ columns.T
        cross += columns @ left
    return gram, cross


def _direction(s: _Series) -> Domain:
    """Return the residual while moving down and up; at rest there is no direction."""
    still = AT_REST * float(np.sqrt(np.mean(s.rate**2)))
    index = np.where(s.rate < -still, 0, np.where(s.rate > still, 1, -1)).astype(np.int64)
    count = np.array([np.sum(index == 0), np.sum(index == 1)])
    if count.min() == 0:
        return _domain(
            s, np.array([-1.0, 1.0]), "sign of the rate", np.ones(2), 1.0, f"{s.port.dof} moves in one direction only"
        )
    square = np.array([np.mean(s.w[index == k] ** 2) for k in (0, 1)])
    means = np.array([np.mean(s.w[index == k]) for k in (0, 1)])
    found = Binned(index, count, square, np.array([-1.0, 1.0]), np.array([-1.0, 0.0, 1.0]))
    p = _both(_energy_test(square, count.astype(float), s.noise_rows), _mean_p(s, s.rate, found, s.noise_rows))
    k = int(np.argmax(square))
    what = (
        f"{s.port.dof} moving {('down', 'up')[k]} (mean residual {means[1]:+.2g} times the noise moving up, "
        f"{means[0]:+.2g} times moving down)"
    )
    return _domain(s, found.centre, "sign of the rate", np.sqrt(square), p, what)


def _frequency(s: _Series) -> Domain:
    """Return the whitened spectrum in logarithmic bands, judged by what repeats or else by what follows the inputs."""
    found = bands(s.w, s.parts, s.rate_hz)
    p = repeat_test(s.w, s.repeats, s.rate_hz) if s.repeats else coherence_test(s.w, s.u, s.parts, s.rate_hz)
    i = int(np.argmax(found.power))
    where = f"{s.port.dof} at {span(found.edges[i, 0], found.edges[i, 1], 'Hz')}"
    return _domain(s, found.centre, "Hz", np.sqrt(found.power), p, where)


def _cross_axis(o: int, joined: Sequence[_Series]) -> Domain:
    """Return how much of one output's residual follows position, rate and acceleration of each other axis.

    Axes that are driven at the same time resemble each other, so an error of this axis's own may seem to follow
    another. The p-value is therefore the larger of that against noise (F test) and the share of time shifts of the
    other axis that explain as much.
    """
    s = joined[o]
    others = [k for k in range(len(joined)) if k != o]
    # what the output's own motion explains is reported elsewhere
    own, _ = np.linalg.qr(_motion_columns(s))
    left = s.w - own @ (own.T @ s.w)
    explained, p_values = np.zeros(len(others)), np.ones(len(others))
    for i, k in enumerate(others):
        columns = _motion_columns(joined[k])
        columns, _ = np.linalg.qr(columns - own @ (own.T @ columns))
        shifted = explained_by_shifts(left, columns)
        dof = s.w.size - 6
        noise = 1.0 if s.noise_rows else (float(left @ left) - shifted[0]) / dof
        explained[i] = np.sqrt(shifted[0] / s.w.size)
        against_noise = float(f_tail(shifted[0] / 3.0 / noise, 3, s.noise_rows or dof))
        p_values[i] = max(against_noise, float(np.mean(shifted >= shifted[0])))
    i = int(np.argmin(p_values))
    floor = np.full(len(others), np.sqrt(3.0 / s.w.size))
    where = (
        f"{s.port.dof}: what follows {joined[others[i]].port.dof} is {explained[i]:.2g} times the noise, by chance "
        f"{floor[i]:.2g}"
    )
    p = min(1.0, float(np.min(p_values)) * len(others))
    return Domain(s.run, s.port.dof, np.array(others, dtype=float), "number of the axis", explained, floor, p, where)


def _motion_columns(other: _Series) -> Array:
    columns = np.stack([other.position, other.rate, np.gradient(other.rate)], axis=1)
    parts = np.concatenate([[0], np.cumsum(other.parts)])
    out = np.empty_like(columns)
    for a, b in zip(parts[:-1], parts[1:], strict=True):
        for j in range(3):
            out[a:b, j] = np.convolve(columns[a:b, j], other.taps)[: b - a]
    size = np.sqrt(np.mean(out**2, axis=0))
    return np.asarray(out / np.where(size > 0.0, size, 1.0))


def _domain(s: _Series, axis: Array, unit: str, level: Array, p: float, what: str) -> Domain:
    top = float(np.max(level))
    return Domain(s.run, s.port.dof, axis, unit, level, np.ones(level.size), p, f"{what}: {top:.3g} times the noise")
