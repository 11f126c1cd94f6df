"""From a segment's loops to the arrays of the compiled loop: feedback, gates, learning, and what is remembered."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sim_backend import layout
from sim_backend.bench import MAX_TAPS, Learning, Segment
from sim_backend.control.blocks import DiscreteFilter
from sim_backend.errors import ConfigError
from sim_backend.kernel import NO_DELAY

Array = NDArray[np.float64]


def controller_of(segment: Segment, n_axes: int, rate_hz: float) -> layout.Controller:
    """Return the loops of `segment` padded to `n_axes`; missing ones do nothing.

    Raises ConfigError when a filter was designed for another rate, or for an axis the bench does not have.
    """
    for kind, given in (("feedback", segment.feedback), ("learning", segment.learning)):
        if len(given) > n_axes:
            raise ConfigError(
                f"segment '{segment.label}': {kind} for {len(given)} axes, the bench has {n_axes}; drop the others"
            )
    feedback = [*segment.feedback, *[None] * (n_axes - len(segment.feedback))]
    learning = [*segment.learning, *[None] * (n_axes - len(segment.learning))]
    filters = [f for f in [*feedback, *(None if le is None else le.filter for le in learning)] if f is not None]
    wrong = [f.rate_hz for f in filters if f.rate_hz != rate_hz]
    if wrong:
        raise ConfigError(
            f"segment '{segment.label}': a controller is for {wrong[0]:g} Hz, the bench runs at {rate_hz:g} Hz; "
            f"design it for that rate"
        )
    fa, fb, fc, fd = _stack(feedback)
    la, lb, lc, ld = _stack([None if le is None else le.filter for le in learning])
    taps = max([len(le.taps) for le in learning if le is not None], default=1)
    return layout.Controller(
        fa,
        fb,
        fc,
        fd,
        np.array([-1 if f is None or f.integrator is None else f.integrator for f in feedback], dtype=np.int64),
        la,
        lb,
        lc,
        ld,
        np.array([0.0 if le is None else le.gain for le in learning]),
        np.array([0 if le is None else le.lead for le in learning], dtype=np.int64),
        np.array([1 if le is None else le.period for le in learning], dtype=np.int64),
        np.array([-1 if le is None else int(le.active) for le in learning], dtype=np.int64),
        np.array([_centred(le, taps) for le in learning]),
    )


@lru_cache(maxsize=16)
def no_controller(n_axes: int) -> layout.Controller:
    """Return loops of so many axes that do nothing: those of an input that is played as it was recorded."""
    rest = np.zeros((1, n_axes))
    return controller_of(Segment("open", 1, rest, rest), n_axes, 1.0)


def _stack(filters: list[DiscreteFilter | None]) -> tuple[Array, Array, Array, Array]:
    m = max([f.n_blocks for f in filters if f is not None], default=0)
    n = len(filters)
    a, b, c, d = np.zeros((n, m, 2, 2)), np.zeros((n, m, 2)), np.zeros((n, m, 2)), np.zeros(n)
    for i, f in enumerate(filters):
        if f is not None:
            a[i, : f.n_blocks], b[i, : f.n_blocks], c[i, : f.n_blocks], d[i] = f.a, f.b, f.c, f.d
    return a, b, c, d


def _centred(learning: Learning | None, length: int) -> Array:
    taps = np.zeros(length)
    own = (1.0,) if learning is None else learning.taps
    start = (length - len(own)) // 2
    taps[start : start + len(own)] = own
    return taps


def events_of(segment: Segment) -> Array:
    """Return the gates as rows (sample, axis, closed, integrator), sorted by sample, shape (n_gates, 4)."""
    rows = sorted((g.at_sample, g.axis, float(g.closed), g.integrator) for g in segment.gates)
    return np.array(rows, dtype=float).reshape(len(rows), 4)


def fresh_memory(plant: layout.Plant, n_axes: int, temperature_k: float) -> layout.Memory:
    """Return the memory of a bench at rest, loops open, at `temperature_k`."""
    n_u = plant.delay_first.size
    late = bool(np.any(plant.delay_first) or np.any(plant.delay_taps[:, 1:]))
    depth = int(np.max(plant.delay_first)) + plant.delay_taps.shape[1] if late else NO_DELAY
    return layout.Memory(
        x=np.zeros((plant.a.shape[0], 2)),
        past=np.zeros(n_u + plant.a.shape[0]),
        has_past=np.zeros(1, dtype=np.int64),
        queue=np.zeros((n_u, depth)),
        acting=np.zeros(n_u),
        xf=np.zeros((n_axes, 0, 2)),
        xl=np.zeros((n_axes, 0, 2)),
        closed=np.zeros(n_axes, dtype=np.int64),
        ring=np.zeros((n_axes, 1)),
        learned=np.zeros((n_axes, 1)),
        samples=np.zeros(1, dtype=np.int64),
        temperature=np.array([temperature_k]),
    )


def refit_memory(mem: layout.Memory, ctl: layout.Controller) -> layout.Memory:
    """Return `mem` with arrays for the loops `ctl`: states start at zero unless they have the same shape as before.

    A learned input whose ring keeps its length goes on; so does a feedback filter, whose states carry over from one
    segment to the next. Axes without feedback or learning are opened.
    """
    n, m = ctl.fb.shape[:2]
    xf = mem.xf if mem.xf.shape == (n, m, 2) else np.zeros((n, m, 2))
    ml = ctl.lb.shape[1]
    xl = mem.xl if mem.xl.shape == (n, ml, 2) else np.zeros((n, ml, 2))
    length = int(np.max(ctl.period)) + MAX_TAPS
    keeps = mem.ring.shape == (n, length)
    ring = mem.ring if keeps else np.zeros((n, length))
    learned = mem.learned if keeps else np.zeros((n, length))
    return mem._replace(xf=xf, xl=xl, ring=ring, learned=learned)
