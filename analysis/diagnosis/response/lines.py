"""Tables of frequency response as points to be compared with a model, some held out, and how well each is known.

The noise is stated by the file, by points measured again, or estimated from how rough the residual is. Misfits of a
model are smooth in frequency between resonances, noise is not. So where nothing else states it, noise is the difference
from a parabola through neighbouring points of the measured response over the modelled one: with weights w that are
orthogonal to parabolas and a sum of squares of one, the difference Σ w q of points with the noise σ has the variance
Σ w² σ². It has a constant part (additive) and one in proportion to the response (separate in magnitude and in phase).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.identification.repeated_points import Averaged, averaged
from analysis.identification.response_files import load_response
from analysis.identification.response_table import Table, read_table
from sim_backend.errors import ConfigError, DataError
from sim_backend.linear import Array, ComplexArray
from sim_backend.model import Model
from sim_backend.small_files import open_regular

Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]

LEAST_LINES = 8
"""Fewest points of a response that a diagnosis needs, as an identification does."""

BLOCKS, EVERY = 60, 5
"""A response is cut into so many blocks of neighbouring points at most; every so many blocks one is held out."""

ENOUGH_TO_HOLD = 40
"""Points of a response from which on some are held out: of fewer, each is needed."""

ROUNDED = 1e-6
"""Relative error below which no table is trusted: digits are cut off."""

PER_LINE = 1.0 / 3.0
"""Independent numbers that a point adds to the level of the noise: neighbouring differences share three of four points,
and a median is worth a third of its numbers."""

_TAIL = 4.0
"""Degrees of freedom of the t-distribution by which single differences are weighed: misfits at resonances are rough."""

_NORMAL = 0.674490
"""Median of the absolute value of a standard normal variable."""

_LEAST_REPEATS = 10


@dataclass(frozen=True)
class Lines:
    """Measured points (n,) in SI units, by entry (output, input), then level, then rising frequency.

    `curve` numbers the curves of one entry at one level, `level` is NaN where none is stated. `count` is how often a
    point was measured, `response` the mean, `scatter` (rows, 3) the differences from it, in magnitude and along the
    phase, with the magnitude of their point. `std` (n,) is the deviation of either part of a point, `coherence` (n,)
    the ordinary one; None where the file has none.
    """

    frequency_hz: Array
    response: ComplexArray
    output: Indices
    input: Indices
    level: Array
    curve: Indices
    count: Array
    scatter: Array
    std: Array | None
    coherence: Array | None
    held_out: Mask
    level_unit: str = ""
    remarks: tuple[str, ...] = ()

    @property
    def n(self) -> int:
        """Number of points."""
        return int(self.frequency_hz.size)

    def only(self, keep: Mask) -> Lines:
        """Return the points that `keep` (n,) marks."""
        own: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "scatter"}
        kept: dict[str, Any] = {n: values[keep] for n, values in own.items() if isinstance(values, np.ndarray)}
        return replace(self, **kept)


def load_lines(path: Path, model: Model, *, level: float | None = None) -> Lines:
    """Return the points of a table, of `level` alone where it is given, each at its entry of `model`.

    A table has one response, which is that of a model of one input and one output; one with the columns output and
    input, as `mccd identify --response` writes them, has any of those that the model names. Raises ConfigError where
    table and model do not go together, DataError as `read_table` and for fewer than eight points.
    """
    entries = _entries(path, model)
    merged = [averaged(table, path) for table, _, _ in entries]
    parts = [_part(one, o, i) for one, (_, o, i) in zip(merged, entries, strict=True)]
    unit = next((one.table.level_unit for one in merged if one.table.level_unit), "")
    remarks = tuple(dict.fromkeys(remark for one in merged for remark in one.table.remarks))
    lines = _joined(parts, unit, remarks)
    if level is not None:
        keep = np.isclose(lines.level, level, rtol=1e-6)
        if not keep.any():
            there = ", ".join(f"{one:g}" for one in np.unique(lines.level[np.isfinite(lines.level)])[:10])
            raise ConfigError(f"{path} has no level {level:g}: it has {there or 'no column of levels'}")
        lines = lines.only(keep)
    lines = lines.only(lines.frequency_hz > 0.0)  # at rest a rigid body has no response
    sizes = np.bincount(lines.curve)
    few = int(sizes[sizes > 0].min()) if lines.n else 0
    if few < LEAST_LINES:
        raise DataError(f"{path} has {few} points of a response above 0 Hz; {LEAST_LINES} are needed to judge a model")
    if np.any(lines.response == 0.0):
        f = lines.frequency_hz[lines.response == 0.0][0]
        raise DataError(f"{path}: the response at {f:g} Hz is zero; leave out points at which nothing was measured")
    return replace(lines, held_out=_held_out(lines.curve))


def _entries(path: Path, model: Model) -> list[tuple[Table, int, int]]:
    outputs, inputs = [p.name for p in model.outputs], [p.name for p in model.inputs]
    if _names_ports(path):
        found = []
        for curve in load_response(path):
            for what, name, known in (("output", curve.output, outputs), ("input", curve.input, inputs)):
                if name not in known:
                    raise ConfigError(f"{path} has the {what} '{name}', the model has {', '.join(known)}; rename it")
            response = curve.magnitude * np.exp(1j * curve.phase_rad)
            std = curve.std if np.isfinite(curve.std).all() and np.all(curve.std > 0.0) else None
            table = Table(curve.frequency_hz, response, None, ("1", "1"), std=std)
            found.append((table, outputs.index(curve.output), inputs.index(curve.input)))
        return found
    table = read_table(path)
    if (len(outputs), len(inputs)) != (1, 1):
        raise ConfigError(
            f"{path} has one response, the model {len(inputs)} inputs and {len(outputs)} outputs; give a model of one "
            "of each, or columns 'output' and 'input' as mccd identify --response writes them"
        )
    ports = model.outputs[0].unit, model.inputs[0].unit
    if table.units != ("1", "1") and table.units != ports:
        told, wanted = (f"{over} per {under}" for over, under in (table.units, ports))
        raise ConfigError(f"{path} is in {told}, the model in {wanted}; give both in the same quantities")
    return [(table, 0, 0)]


HEAD_CHARS = 2**16
"""Longest line of names."""


def _names_ports(path: Path) -> bool:
    """Tell whether the columns of a table name outputs and inputs."""
    if path.suffix.lower() != ".csv":
        return False
    with open(open_regular(path), encoding="utf-8", errors="replace") as file:
        return {"output", "input"} <= {name.strip() for name in file.readline(HEAD_CHARS).split(",")}


@dataclass(frozen=True)
class _Part:
    """One response with its repeated points averaged; arrays as in Lines."""

    arrays: dict[str, Array]
    response: ComplexArray
    scatter: Array
    output: int
    input: int


def _part(one: Averaged, output: int, input_: int) -> _Part:
    """Return a table, whose repeated points are averaged, as one response."""
    table, size = one.table, one.table.frequency_hz.size
    level = np.full(size, np.nan) if table.level is None else table.level
    arrays = {"frequency_hz": table.frequency_hz, "level": level, "count": one.count}
    if table.std is not None:
        arrays["std"] = table.std
    if table.coherence is not None:
        arrays["coherence"] = table.coherence
    return _Part(arrays, table.response, one.scatter, output, input_)


def _joined(parts: list[_Part], unit: str, remarks: tuple[str, ...]) -> Lines:
    def all_of(name: str) -> Array:
        return np.concatenate([part.arrays[name] for part in parts])

    def told(name: str) -> Array | None:
        return all_of(name) if all(name in part.arrays for part in parts) else None

    sizes = [part.response.size for part in parts]
    places = np.array([(part.output, part.input) for part in parts]).repeat(sizes, axis=0).astype(np.int64)
    level = all_of("level")
    entry = np.arange(len(parts)).repeat(sizes)
    _, curve = np.unique(np.stack([entry, np.nan_to_num(level)], axis=1), axis=0, return_inverse=True)
    return Lines(
        frequency_hz=all_of("frequency_hz"),
        response=np.concatenate([part.response for part in parts]),
        output=places[:, 0],
        input=places[:, 1],
        level=level,
        curve=curve.reshape(-1).astype(np.int64),
        count=all_of("count"),
        scatter=np.concatenate([part.scatter for part in parts]),
        std=told("std"),
        coherence=told("coherence"),
        held_out=np.zeros(level.size, dtype=bool),
        level_unit=unit,
        remarks=remarks,
    )


def _held_out(curve: Indices) -> Mask:
    """Return which points (n,) no fit may see: every fifth block of neighbours of each curve with enough points."""
    held = np.zeros(curve.size, dtype=bool)
    for number in np.unique(curve):
        rows = np.flatnonzero(curve == number)
        if rows.size >= ENOUGH_TO_HOLD:
            length = -(-rows.size // BLOCKS)
            held[rows] = (np.arange(rows.size) // length) % EVERY == EVERY // 2
    return held


@dataclass(frozen=True)
class Noise:
    """Standard deviations `sigma` (n, 2) of every point along its phase and across it, in units of the response.

    Their level is known from `dof` independent numbers, infinitely many where the file states it; `source` says how.
    """

    sigma: Array
    dof: float
    source: str


def noise_of(lines: Lines, modelled: ComplexArray) -> Noise:
    """Return the noise of the points (n,) about a model's response (n,)."""
    if lines.std is not None:
        return Noise(np.repeat(lines.std[:, None], 2, axis=1), np.inf, "standard deviations of the table")
    size = np.abs(lines.response)
    if lines.scatter.shape[0] >= _LEAST_REPEATS:
        along, across, of = lines.scatter.T
        part, rest = _levels(along / of, across / of, 1.0 / of**2)
        return Noise(_sigma(lines, size, part, rest), float(np.sum(2.0 * (lines.count - 1.0))), "repeated points")
    along, across, weights, at = _roughness(lines, modelled)
    dof = max(PER_LINE * along.size, 2.0)
    if lines.coherence is not None:
        # S. Braun, Discover Signal Processing (2008): var |H| / |H|² = (1 - γ²) / (2 γ² averages)
        coherence = np.clip(lines.coherence, 1e-6, 1.0 - 1e-6)
        relative2 = (1.0 - coherence) / (2.0 * coherence)
        expected = np.sqrt(np.sum(weights**2 * relative2[at], axis=1))
        level = float(np.median(np.abs([along, across]) / expected)) / _NORMAL
        sigma = np.maximum(level * np.sqrt(relative2), ROUNDED) * size
        return Noise(np.repeat(sigma[:, None], 2, axis=1), dof, "coherence, its level from roughness")
    part, rest = _levels(along, across, np.sum(weights**2 / size[at] ** 2, axis=1))
    return Noise(_sigma(lines, size, part, rest), dof, "roughness of the residual")


def _sigma(lines: Lines, size: Array, part: Array, additive: float) -> Array:
    relative = np.maximum(part, ROUNDED)
    return np.asarray(np.sqrt((additive**2 + np.outer(size, relative) ** 2) / lines.count[:, None]))


def _roughness(lines: Lines, modelled: ComplexArray) -> tuple[Array, Array, Array, NDArray[np.int64]]:
    """Return differences in magnitude and phase (m,), each with its weights (m, 4) on the points `at` (m, 4)."""
    error = (lines.response - modelled) / modelled
    curves = [np.flatnonzero(lines.curve == number) for number in np.unique(lines.curve)]
    at = np.concatenate([np.lib.stride_tricks.sliding_window_view(rows, 4) for rows in curves])
    x = np.log(lines.frequency_hz[at])
    # divided differences of third order: 1 / Π (x_k - x_j)
    apart = x[:, :, None] - x[:, None, :] + np.eye(4)
    weights = 1.0 / np.prod(apart, axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    rough = np.sum(weights * error[at], axis=1)
    return rough.real, rough.imag, weights, at


def _levels(along: Array, across: Array, per_size2: Array) -> tuple[Array, float]:
    """Return the relative parts in magnitude and phase (2,), and the additive one, of relative differences (m,)."""
    both = np.stack([along, across])
    start = np.median(np.abs(both), axis=1) / _NORMAL + ROUNDED
    additive = float(np.median(start)) / np.sqrt(float(np.median(per_size2)))

    def variance(x: Array) -> Array:
        return np.exp(2.0 * x[:2])[:, None] + np.exp(2.0 * x[2]) * per_size2 + ROUNDED**2

    def cost(x: Array) -> float:
        v = variance(x)
        return float(np.sum(0.5 * np.log(v) + 0.5 * (_TAIL + 1.0) * np.log1p(both**2 / (_TAIL * v))))

    begin = np.log([*start, additive]) - 0.35
    found = scipy.optimize.minimize(cost, begin, method="Nelder-Mead", options={"maxiter": 400, "xatol": 1e-3}).x
    ratio = float(np.median(np.abs(both) / np.sqrt(variance(found)))) / _NORMAL
    return np.exp(found[:2]) * ratio, float(np.exp(found[2])) * ratio
