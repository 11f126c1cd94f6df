"""A model on records that it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.identification.identified import HeldOut
from analysis.identification.validation import relative_error
from analysis.linear.simulate import periodic_response, simulate_linear
from analysis.recorded.folded import windowed
from campaigns.log import LogSegment, Run
from sim_backend.intersample import steps_for
from sim_backend.linear import Array, DiscreteModel, ModalModel, delay_taps, played
from sim_backend.model import Intersample

START_ROWS = 20_000
"""Samples from which the initial motion of a segment is estimated."""


def tried(
    model: ModalModel,
    parts: Sequence[tuple[Run, LogSegment]],
    rate_hz: float,
    offset: Array | float = 0.0,
    *,
    intersample: Intersample = "held",
) -> tuple[HeldOut, ...]:
    """Return the errors on every held-out segment: in steady state where it is periodic, else from the best start.

    `offset` (n_y,) is what each output reads at rest. The motion that a segment begins with is nobody's error, and what
    swings on from before goes with a steady state; what nothing holds has none. Of a segment too long to be read at
    once, the middle is tried.
    """
    free = bool(np.any(model.omega_rad_s == 0.0))
    discrete, results = played(model, rate_hz), []
    for run, segment in windowed(parts):
        if not segment.held_out:
            continue
        period = 0 if free else int(segment.settings.get("period_samples", 0))
        if period:
            segment = replace(segment, start=max(segment.stop - period, segment.start))
        u, y = channels_of(run, segment, "input"), channels_of(run, segment, "output")
        steps = steps_for(u, period=period) if intersample == "band-limited" else u
        if period:
            frequency = np.arange(period // 2 + 1) * rate_hz / period
            modelled = periodic_response(model.frequency_response(frequency, rate_hz), steps)
            modelled = modelled - modelled.mean(axis=0) + y.mean(axis=0)  # multisines have no line at 0 Hz
            modelled = modelled + _swing(discrete, y - modelled)
        else:
            skip = _unknown_rows(discrete, y.shape[0])
            start = _start_of(discrete, steps, y - offset, skip)
            modelled = simulate_linear(discrete, steps, start)[skip:] + offset
            y = y[skip:]
        error = relative_error(y, modelled)
        results.append(
            HeldOut(
                run.run_uid,
                segment.label,
                dict(zip(run.names("output"), error.per_channel.tolist(), strict=True)),
                error.total,
            )
        )
    return tuple(results)


def error_of_free_run(model: ModalModel, u: Array, y: Array, rate_hz: float) -> float:
    """Return the sum of squares of what a model misses of a record from its best start, each output by its size.

    Shapes (n, n_u) and (n, n_y), `y` without what it reads at rest.
    """
    discrete = played(model, rate_hz)
    modelled = simulate_linear(discrete, u, _start_of(discrete, u, y, 0))
    return float(np.sum(((modelled - y) / y.std(axis=0)) ** 2))


def _unknown_rows(model: DiscreteModel, rows: int) -> int:
    """Return for how many samples a delayed input comes from before the segment, where nobody knows it."""
    if not np.any(model.delay_samples):
        return 0
    unknown = max(delay_taps(float(late)).reach for late in model.delay_samples)
    return unknown if unknown < rows // 2 else 0


def _swing(model: DiscreteModel, rest: Array) -> Array:
    """Return the free motion (n, n_y) of the modes that meets what a steady state leaves, `rest`, best."""
    nothing = np.zeros((rest.shape[0], model.b.shape[2]))
    return simulate_linear(model, nothing, _start_of(model, nothing, rest, 0))


def _start_of(model: DiscreteModel, u: Array, y: Array, skip: int) -> Array:
    """Return the states (m, 2) from which `u` (n, n_u) gives `y` (n, n_y) best, by the residual of a start from rest.

    The first `skip` samples do not count.
    """
    m = model.a.shape[0]
    rows = min(u.shape[0], START_ROWS)
    u, left = u[:rows], (y[:rows] - simulate_linear(model, u[:rows]))[skip:]
    free = []
    for unit in np.eye(2 * m):
        free.append(simulate_linear(model, np.zeros_like(u), unit.reshape(m, 2))[skip:].ravel())
    columns = np.stack(free, axis=1)
    scale = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    return np.asarray(np.linalg.lstsq(columns / scale, left.ravel(), rcond=1e-9)[0] / scale).reshape(m, 2)


def channels_of(run: Run, segment: LogSegment, role: str) -> Array:
    """Return the channels of a role in one segment, (n, channels)."""
    return np.stack([run.read(name, segment.start, segment.stop) for name in run.names(role)], axis=1)
