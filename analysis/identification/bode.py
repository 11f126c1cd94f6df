"""The Bode picture of an identification: what was measured by frequency beside the model, entry by entry."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from analysis.frequency.frf_records import frequency_response_welch
from analysis.identification.identified import Identification
from analysis.identification.response_curves import ResponseCurve, curves_of_periods
from campaigns.facts import measured_segments
from campaigns.log import Run
from campaigns.log.plot import write_picture
from sim_backend.errors import DataError
from sim_backend.intersample import hold_response

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PIECES = 8
"""Half-overlapping pieces into which a record that is fitted in time is cut for its picture."""

POINTS = 800


def measured_curves(found: Identification, runs: Sequence[Run]) -> tuple[ResponseCurve, ...]:
    """Return what was measured by frequency; of records fitted in time the averaged response of the longest segment."""
    if found.response:
        return found.response
    run, segment = max(
        ((run, s) for run in runs for s in measured_segments(run) if not s.held_out), key=lambda pair: pair[1].rows
    )
    inputs, outputs = run.names("input"), run.names("output")
    u, y = (
        np.stack([run.read(name, segment.start, segment.stop) for name in names], axis=1) for names in (inputs, outputs)
    )
    piece = 2 * segment.rows // (PIECES * len(inputs) + 1)
    try:
        measured = frequency_response_welch(u - u.mean(axis=0), y - y.mean(axis=0), run.sample_rate_hz, piece)
    except DataError:
        return ()
    # lines at which next to nothing was played tell nothing
    power = np.mean(np.abs(np.fft.rfft(u[:piece] - u[:piece].mean(axis=0), axis=0)) ** 2, axis=1)
    grid = np.fft.rfftfreq(piece, 1.0 / run.sample_rate_hz)
    excited = np.interp(measured.frequency_hz, grid, power) > 1e-4 * power.max()
    return tuple(_only(curve, excited) for curve in curves_of_periods(measured, inputs, outputs))


def _only(curve: ResponseCurve, keep: np.ndarray) -> ResponseCurve:
    arrays = (curve.frequency_hz, curve.magnitude, curve.phase_rad, curve.std, curve.noise_std)
    return ResponseCurve(curve.output, curve.input, *(values[keep] for values in arrays))


def bode(found: Identification, curves: Sequence[ResponseCurve]) -> Figure:
    """Return a figure with magnitude and phase of every entry: dots measured, line modelled."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    model, linear = found.model, found.model.linear()
    rate_hz = model.sample_rate_hz
    inputs, outputs = [p.name for p in model.inputs], [p.name for p in model.outputs]
    figure = Figure(figsize=(4.5 * len(inputs) + 0.6, 4.2 * len(outputs)), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(2 * len(outputs), len(inputs), sharex=True, squeeze=False)
    frequency = np.concatenate([curve.frequency_hz for curve in curves]) if curves else np.array([0.5 * rate_hz])
    low = max(float(frequency[frequency > 0.0].min(initial=np.inf)), 1e-4 * rate_hz)
    f = np.geomspace(min(low, 0.1 * rate_hz), min(max(float(frequency.max()), 2.0 * low), 0.499 * rate_hz), POINTS)
    response = linear.frequency_response(f, rate_hz)
    if model.intersample == "band-limited":
        response = response / hold_response(f / rate_hz)[:, None, None]
    units = {p.name: p.unit for p in (*model.inputs, *model.outputs)}
    for k, output in enumerate(outputs):
        for j, input_ in enumerate(inputs):
            size, phase = grid[2 * k, j], grid[2 * k + 1, j]
            for curve in curves:
                if (curve.output, curve.input) == (output, input_):
                    size.loglog(curve.frequency_hz, curve.magnitude, ".", markersize=3, color="C0", label="measured")
                    phase.semilogx(curve.frequency_hz, np.degrees(curve.phase_rad), ".", markersize=3, color="C0")
            size.loglog(f, np.abs(response[:, k, j]), color="C1", linewidth=1.2, label="model")
            phase.semilogx(f, np.degrees(np.angle(response[:, k, j])), color="C1", linewidth=1.2)
            size.set_title(f"{input_} → {output}", fontsize=9)
            size.set_ylabel(f"magnitude ({units[output]} per {units[input_]})", fontsize=8)
            phase.set_ylabel("phase (°)", fontsize=8)
            phase.set_yticks([-180, -90, 0, 90, 180])
            for ax in (size, phase):
                ax.grid(visible=True, which="both", alpha=0.25, linewidth=0.5)
    for ax in grid[-1]:
        ax.set_xlabel("frequency (Hz)")
    grid[0, 0].legend(fontsize=8)
    return figure


def save_bode(found: Identification, runs: Sequence[Run], path: Path) -> None:
    """Write the Bode picture; `campaigns.log.plot.require_picture` tells beforehand whether it can be."""
    write_picture(bode(found, measured_curves(found, runs)), path)
