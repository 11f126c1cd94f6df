"""Basis functions of what a bench can do that no model has: none is a listed cause, and every cause resembles some.

Each function gives a few signals at one location: torques at an input, which the plant takes to the outputs, or errors
of a reading. They are no causes and get no name; a cause does not explain the residual that follows one of them beside
it. A new one is one function and one line in `TORQUES` or `READINGS`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.candidates.signature import Motion
from analysis.diagnosis.nominal.responses import no_columns, response
from sim_backend.assembly import Places
from sim_backend.jit import njit
from sim_backend.linear import Array, DiscreteModel

_SLOW, _CHANGING = 9, 5
"""Cosines over the whole time, the constant among them, of what is slow, and of how a size changes."""

_SHORTEST, _LADDER = 3.0, 10.0**0.5
"""Shortest memory in samples, and the ratio of one memory to the next: a first-order lag in between is a weighted sum
of its neighbours to a tenth."""

_STEEP = 20.0
"""A rate above a twentieth of its swing has a direction."""

_TAIL = (0.5, 0.8, 0.95, 0.99, 0.998)
"""Parts of all samples in which a signal is smaller than where something may begin: a stop, or a limit of the drive."""

_PLAYS = (0.01, 0.03, 0.1, 0.3, 0.8)
"""Half the play, in swings, of a play operator on the position."""


@dataclass(frozen=True)
class Scene:
    """One record in units of the swings of the whole data, samples first.

    `u`, `x` and `v` (n, n_u) are command, position and rate at each input, `seen` and `seen_rate` (n, n_y) those of
    each output, `time` (n, 9) cosines over all records, the first constant, `kelvin` (n,) the temperature's deviation;
    `longest` are the samples of the longest record. `u_tail`, `x_tail` (n_u, 5) and `seen_tail` (n_y, 5) are sizes that
    the signals of all records seldom exceed.
    """

    u: Array
    x: Array
    v: Array
    seen: Array
    seen_rate: Array
    time: Array
    kelvin: Array | None
    longest: int
    u_tail: Array
    x_tail: Array
    seen_tail: Array


BasisFunction = Callable[[Scene, int], list[Array]]


def _of_motion(s: Scene, j: int) -> list[Array]:
    x, v = s.x[:, j], s.v[:, j]
    odd = [x * abs(x), x**3, x**5, v * abs(v), v**3, np.tanh(_STEEP * v)]
    return [*odd, x * x, x * v, v * v, x * x * v, x * v * v, abs(x) * v]


def _of_command(s: Scene, j: int) -> list[Array]:
    u, x, v = s.u[:, j], s.x[:, j], s.v[:, j]
    return [u * u, u * abs(u), u**3, u**5, np.tanh(_STEEP * u), u * x, u * x * x, u * v]


def _of_large_commands(s: Scene, j: int) -> list[Array]:
    return _beyond(s.u[:, j], s.u_tail[j])


def _of_large_positions(s: Scene, j: int) -> list[Array]:
    return _beyond(s.x[:, j], s.x_tail[j])


def _of_turns(s: Scene, j: int) -> list[Array]:
    return [s.x[:, j] - _behind(np.ascontiguousarray(s.x[:, j]), play) for play in _PLAYS]


def _of_past_commands(s: Scene, j: int) -> list[Array]:
    return [s.u[:, j], *_memories(s.u[:, j], s.longest)]


def _of_past_motion(s: Scene, j: int) -> list[Array]:
    return [s.x[:, j], s.v[:, j], *_memories(s.x[:, j], s.longest)]


def _of_time(s: Scene, j: int) -> list[Array]:
    return list(s.time.T)


def _changing(s: Scene, j: int) -> list[Array]:
    return [a * c for a in (s.u[:, j], s.x[:, j], s.v[:, j]) for c in s.time.T[1:_CHANGING]]


def _of_temperature(s: Scene, j: int) -> list[Array]:
    return [] if s.kelvin is None else [s.kelvin * a for a in (1.0, s.u[:, j], s.x[:, j], s.v[:, j])]


def _of_other_inputs(s: Scene, j: int) -> list[Array]:
    return [a[:, i] for i in range(s.u.shape[1]) if i != j for a in (s.u, s.x, s.v)]


def _of_several_axes(s: Scene, j: int) -> list[Array]:
    # all products of second order of two axes: two others' among them
    own, others = (s.x[:, j], s.v[:, j], s.u[:, j]), [i for i in range(s.u.shape[1]) if i != j]
    mixed = [a * b[:, i] for i in others for a in own for b in (s.x, s.v, s.u)]
    apart = [s.x[:, i] * b[:, k] for n, i in enumerate(others) for k in others[n:] for b in (s.x, s.v)]
    return [*mixed, *apart]


def _reading_of_motion(s: Scene, o: int) -> list[Array]:
    x, v = s.seen[:, o], s.seen_rate[:, o]
    return [x * x, abs(x), x**3, x**5, v * v, np.tanh(_STEEP * v)]


def _reading_of_large_positions(s: Scene, o: int) -> list[Array]:
    return _beyond(s.seen[:, o], s.seen_tail[o])


def _reading_changing(s: Scene, o: int) -> list[Array]:
    return [a * c for a in (s.seen[:, o], s.seen_rate[:, o]) for c in s.time.T[1:_CHANGING]]


def _reading_of_others(s: Scene, o: int) -> list[Array]:
    return [a[:, i] for i in range(s.seen.shape[1]) if i != o for a in (s.seen, s.seen_rate)]


TORQUES: dict[str, BasisFunction] = {
    "position and rate": _of_motion,
    "the command": _of_command,
    "large positions": _of_large_positions,
    "large commands": _of_large_commands,
    "where the position turned": _of_turns,
    "past commands": _of_past_commands,
    "past positions": _of_past_motion,
    "time": _of_time,
    "command and motion with a gain that changes slowly": _changing,
    "temperature": _of_temperature,
    "other degrees of freedom": _of_other_inputs,
    "products of degrees of freedom": _of_several_axes,
}
"""What a torque at an input may depend on."""

READINGS: dict[str, BasisFunction] = {
    "position and rate": _reading_of_motion,
    "large positions": _reading_of_large_positions,
    "time": _of_time,
    "the motion with a gain that changes slowly": _reading_changing,
    "other readings": _reading_of_others,
}
"""What the error of a reading may depend on."""

SLOWEST = frozenset({"time"})
"""Basis functions in the lowest cosine coefficients of a record, where its noise is known from a dozen numbers."""


def _beyond(a: Array, tail: Array) -> list[Array]:
    """Return by how much `a` (n,) exceeds each size of a `tail`, with its sign and without."""
    excess = [np.maximum(np.abs(a) - edge, 0.0) for edge in tail]
    return [*(np.sign(a) * e for e in excess), *excess]


@njit
def _behind(x, play):  # type: ignore[no-untyped-def]
    """Return the play operator of half-width `play` on `x` (n,), started at `x`."""
    out = np.empty_like(x)
    at = x[0]
    for i in range(x.size):
        at = min(max(at, x[i] - play), x[i] + play)
        out[i] = at
    return out


def _memories(x: Array, longest: int) -> list[Array]:
    """Return `x` (n,) behind first-order lags of a ladder of times, up to a quarter of the `longest` record."""
    count = max(int(np.log(longest / 4.0 / _SHORTEST) / np.log(_LADDER)) + 1, 1)
    poles = np.exp(-1.0 / (_SHORTEST * _LADDER ** np.arange(count)))
    return [recursion(x, 1.0 - a, a, 0.0) for a in poles]


def recursion(x: Array, gain: float, once: float, twice: float) -> Array:
    """Return y (n,) with y[k] = gain x[k] + once y[k-1] + twice y[k-2], from rest."""
    out = np.empty(x.size)
    _recursion(x, gain, once, twice, out)
    return out


@njit
def _recursion(x, gain, once, twice, out):  # type: ignore[no-untyped-def]
    """Fill `out` (n,); scipy.signal has such a filter, and takes a second to be imported."""
    last, before = 0.0, 0.0
    for k in range(x.size):
        last, before = gain * x[k] + once * last + twice * before, last
        out[k] = last


def scenes_of(motions: Sequence[Motion], places: Places) -> list[Scene]:
    """Return every record in units of the swings of all."""
    rows = sum(m.u.shape[0] for m in motions)
    time = (np.arange(rows) + 0.5) / rows
    slow = np.cos(np.pi * time[:, None] * np.arange(_SLOW))
    ends = np.cumsum([m.u.shape[0] for m in motions])
    kelvins = [m.temperature_k for m in motions if m.temperature_k is not None]
    warm = len(kelvins) == len(motions)
    middle = float(np.mean(np.concatenate(kelvins))) if warm else 0.0
    swing = _swings([m.u for m in motions])
    moved = _swings([m.position @ places.coordinates.T for m in motions])
    fast = _swings([m.rate @ places.coordinates.T for m in motions])
    seen, seen_fast = _swings([m.sensed for m in motions]), _swings([m.rate for m in motions])
    u_tail, x_tail, seen_tail = (
        np.quantile(np.abs(np.concatenate(parts)), _TAIL, axis=0).T
        for parts in (
            [m.u / swing for m in motions],
            [m.position @ places.coordinates.T / moved for m in motions],
            [m.sensed / seen for m in motions],
        )
    )
    return [
        Scene(
            m.u / swing,
            m.position @ places.coordinates.T / moved,
            m.rate @ places.coordinates.T / fast,
            m.sensed / seen,
            m.rate / seen_fast,
            slow[end - m.u.shape[0] : end],
            m.temperature_k - middle if warm and m.temperature_k is not None else None,
            max(one.u.shape[0] for one in motions),
            u_tail,
            x_tail,
            seen_tail,
        )
        for m, end in zip(motions, ends, strict=True)
    ]


def _swings(parts: Sequence[Array]) -> Array:
    """Return the largest size of each column over all parts, one where it never moves."""
    largest = np.max([np.max(np.abs(p), axis=0, initial=0.0) for p in parts], axis=0)
    return np.where(largest > 0.0, largest, 1.0)


def columns_at(scene: Scene, plant: DiscreteModel, what: str, output: bool, at: int) -> Array:
    """Return the outputs' change (n, n_y, k) by a torque at input `at` that follows `what`.

    With `output` it is an error of the reading with that number.
    """
    signals = (READINGS if output else TORQUES)[what](scene, at)
    out = no_columns(scene.seen, len(signals))
    for k, signal in enumerate(signals):
        if output:
            out[:, at, k] = signal
        else:
            response(plant, np.ascontiguousarray(signal), at, out=out[:, :, k])
    return out
