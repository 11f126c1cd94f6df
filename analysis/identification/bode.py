"""The Bode picture of an identification: what was measured by frequency beside the model, entry by entry."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from analysis.frequency.frf import frequency_response_periodic
from analysis.frequency.frf_records import frequency_response_welch
from analysis.identification.identified import Identification
from analysis.identification.modelled_response import frequencies_of, response_of
from analysis.identification.realisations import realisations_of
from analysis.identification.record_remarks import is_stepped_sine
from analysis.identification.response_curves import ResponseCurve, curve_of_sweep, curves_of_periods
from analysis.recorded.sweep import sweep_of
from campaigns.facts import measured_segments
from campaigns.log import ROLES, LogSegment, Run
from campaigns.log.plot import write_picture
from sim_backend.axis_names import with_axes
from sim_backend.errors import DataError
from sim_backend.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PIECES = 8
"""Half-overlapping pieces into which a record that is fitted in time is cut for its picture."""


WEAKEST = 1e-6
"""Part of the strongest line's power below which the input says nothing of the response, as in a diagnosis."""


def measured_curves(found: Identification, runs: Sequence[Run]) -> tuple[ResponseCurve, ...]:
    """Return what was measured by frequency; of records fitted in time the averaged response of the longest stretch."""
    return found.response or _averaged([(run, s) for run in runs for s in measured_segments(run) if not s.held_out])


def curves_of_run(run: Run) -> tuple[ResponseCurve, ...]:
    """Return what one run measured by frequency: its sines, its periods, or the average of its longest stretch.

    Empty where it holds no excitation; raises DataError as reading it does.
    """
    if is_stepped_sine(run):
        sweep = sweep_of(run)
        ends = [next(c.name for c in run.channels.values() if (c.role, c.dof) == (r, sweep.axis)) for r in ROLES[:2]]
        return (curve_of_sweep(sweep, *ends),)
    parts = [(run, s) for s in measured_segments(run) if not s.held_out]
    if not parts or not run.names("input") or not run.names("output"):
        return ()
    periodic = realisations_of(parts)
    if periodic is not None:
        measured = frequency_response_periodic(periodic.inputs, periodic.outputs, periodic.rate_hz)
        return curves_of_periods(measured, run.names("input"), run.names("output"))
    return _averaged(parts)


class _Stretch(NamedTuple):
    """Segments of a run with no sample between them; `period` is the number of samples of one, 0 without."""

    run: Run
    start: int
    stop: int
    period: int


def _stretches(parts: Sequence[tuple[Run, LogSegment]]) -> list[_Stretch]:
    """Return the segments, joined where one follows the other and neither repeats itself: fewer ends leak less."""
    found: list[_Stretch] = []
    for run, segment in parts:
        one = _Stretch(run, segment.start, segment.stop, int(segment.settings.get("period_samples", 0)))
        before = found[-1] if found else None
        if before is not None and before.run is run and before.stop == one.start and not (before.period or one.period):
            found[-1] = before._replace(stop=one.stop)
        else:
            found.append(one)
    return found


def _averaged(parts: Sequence[tuple[Run, LogSegment]]) -> tuple[ResponseCurve, ...]:
    run, start, stop, period = max(_stretches(parts), key=lambda one: one.stop - one.start)
    rows = stop - start
    read = {name: run.read(name, start, stop) for role in ("input", "output") for name in run.names(role)}
    inputs = tuple(name for name in run.names("input") if np.ptp(read[name]) > 0.0)  # one at rest shows nothing
    outputs = run.names("output")
    if not inputs:
        return ()
    u, y = (np.stack([read[name] for name in names], axis=1) for names in (inputs, outputs))
    period = period or 1
    piece = 2 * rows // (PIECES * len(inputs) + 1)
    piece = max(piece // period, 1) * period if 2 * period <= rows else piece  # whole periods do not leak
    try:
        measured = frequency_response_welch(u - u.mean(axis=0), y - y.mean(axis=0), run.sample_rate_hz, piece)
    except DataError:
        return ()
    # lines at which next to nothing was played carry no information
    power = np.mean(np.abs(np.fft.rfft(u[:piece] - u[:piece].mean(axis=0), axis=0)) ** 2, axis=1)
    grid = np.fft.rfftfreq(piece, 1.0 / run.sample_rate_hz)
    excited = np.interp(measured.frequency_hz, grid, power) > WEAKEST * power.max()
    return tuple(_only(curve, excited) for curve in curves_of_periods(measured, inputs, outputs))


def _only(curve: ResponseCurve, keep: np.ndarray) -> ResponseCurve:
    arrays = (curve.frequency_hz, curve.magnitude, curve.phase_rad, curve.std, curve.noise_std)
    return ResponseCurve(curve.output, curve.input, *(values[keep] for values in arrays))


def bode(model: Model, curves: Sequence[ResponseCurve], *, continuous: bool = False) -> Figure:
    """Return a figure with magnitude and phase of every entry of a model: dots measured, line modelled.

    The model's response is that to a `continuous` input where the curves are, as those of a table.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    inputs, outputs = [p.name for p in model.inputs], [p.name for p in model.outputs]
    figure = Figure(figsize=(4.5 * len(inputs) + 0.6, 4.2 * len(outputs)), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(2 * len(outputs), len(inputs), sharex=True, squeeze=False)
    f = frequencies_of(model, curves)
    response = response_of(model, f, continuous=continuous)
    units = {p.name: p.unit for p in (*model.inputs, *model.outputs)}
    for k, output in enumerate(outputs):
        for j, input_ in enumerate(inputs):
            size, phase = grid[2 * k, j], grid[2 * k + 1, j]
            for curve in curves:
                if (curve.output, curve.input) == (output, input_):
                    size.loglog(curve.frequency_hz, curve.magnitude, ".", markersize=3, color="C0", label="measured")
                    phase.semilogx(curve.frequency_hz, np.degrees(curve.phase_rad), ".", markersize=3, color="C0")
            if np.any(response[:, k, j]):  # an entry that nothing drives has no magnitude to draw
                size.loglog(f, np.abs(response[:, k, j]), color="C1", linewidth=1.2, label="model")
                phase.semilogx(f, np.degrees(np.angle(response[:, k, j])), color="C1", linewidth=1.2)
            size.set_title(with_axes(f"{input_} → {output}"), fontsize=9)
            size.set_ylabel(f"magnitude ({units[output]} per {units[input_]})", fontsize=8)
            phase.set_ylabel("phase (°)", fontsize=8)
            phase.set_yticks([-180, -90, 0, 90, 180])
            for ax in (size, phase):
                ax.grid(visible=True, which="both", alpha=0.25, linewidth=0.5)
    for ax in grid[-1]:
        ax.set_xlabel("frequency (Hz)")
    drawn = [axes for axes in grid.reshape(-1) if axes.get_legend_handles_labels()[0]]
    if drawn:
        drawn[0].legend(fontsize=8)
    return figure


def save_bode(found: Identification, runs: Sequence[Run], path: Path) -> None:
    """Write the Bode picture; `campaigns.log.plot.require_picture` tells beforehand whether it can be."""
    write_picture(bode(found.model, measured_curves(found, runs), continuous=found.of_a_table), path)
