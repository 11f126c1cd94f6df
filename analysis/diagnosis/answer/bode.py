"""The linear response of data, nominal and extended model, where the records tell one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from analysis.diagnosis.answer.figures import AFTER, BEFORE, Drawn
from analysis.diagnosis.result import Diagnosis
from analysis.frequency.averaged_spectra import averaged_spectra
from analysis.frequency.frf import FrequencyResponse
from analysis.pages.bode import bode_canvas, per, scale_axes
from analysis.pages.canvas import INK
from sim_backend.assembly import places_of, retuned
from sim_backend.errors import DataError
from sim_backend.linear import ComplexArray
from sim_backend.model import Model

Array = NDArray[np.float64]

SIZE = (4.8, 3.9)
PIECES = 5
"""Pieces, half overlapping, that the longest record is cut into: the more, the less noise and the coarser the lines."""

MOST_ROWS = 16384
WEAKEST = 1e-6
"""Part of the strongest line's power below which an input says nothing of the response there."""

KNOWN = 0.1
"""Largest standard deviation of a point that is drawn, relative to the response."""

LEAST_POINTS = 12
PER_DECADE = 60
CURVE_POINTS = 500


def bode_figure(diagnosis: Diagnosis, model: Model, output: int) -> Drawn | None:
    """Return magnitude and phase of the response of `output` to the input that drives it most.

    None where the records tell no linear response: inputs that never move apart, or too few lines above the noise.
    """
    from matplotlib.ticker import MultipleLocator  # see `analysis.pages.canvas`

    found = _measured(diagnosis, output)
    if found is None:
        return None
    response, column, j = found
    g, std = response.response[:, output, column], np.sqrt(response.noise_variance[:, output, column])
    f = response.frequency_hz
    good = _thinned_lines(f, np.where(np.abs(g) > 0.0, std / np.maximum(np.abs(g), 1e-300), np.inf))
    if good.size < LEAST_POINTS:
        return None
    source, target = model.inputs[j], model.outputs[output]
    title = target.dof if source.dof == target.dof else f"{source.dof} → {target.dof}"
    canvas = bode_canvas(f"Frequency response {title}", title, per(target.unit, source.unit), SIZE)
    curve_f = np.geomspace(f[good[0]], f[good[-1]], CURVE_POINTS)
    models = _models(diagnosis, model, curve_f, output, j)
    # of all whole turns the one nearest to the nominal model, which has no gaps between its frequencies
    near = np.interp(f[good], curve_f, _degrees(models[0][2]))
    dots = {"color": INK, "marker": ".", "markersize": 2.5}
    canvas.points(0, "measured", f[good], np.abs(g[good]), **dots)
    turned = near + np.degrees(np.angle(g[good] * np.exp(-1j * np.radians(near))))
    canvas.points(1, "measured", f[good], turned, **dots)
    for name, colour, values in models:
        canvas.line(0, name, curve_f, np.abs(values), color=colour, linewidth=1.1)
        canvas.line(1, name, curve_f, _degrees(values), color=colour, linewidth=1.1)
    scale_axes(canvas)
    canvas.axes[1].yaxis.set_major_locator(MultipleLocator(90.0))
    canvas.legend_above(0)
    caption = (
        f"Response of {target.dof} to {source.dof}: measured (averaged spectra of all records; frequencies where it is "
        f"known to {100.0 * KNOWN:.0f} % or better), the nominal model as given, and the linear part of the extended "
        "one. What depends on amplitude shows here as a mean over what was played."
    )
    return Drawn("bode", canvas.title, caption, canvas)


def _models(diagnosis: Diagnosis, model: Model, f: Array, output: int, j: int) -> list[tuple[str, str, ComplexArray]]:
    rate = diagnosis.data.rate_hz
    extended = retuned(diagnosis.linear, diagnosis.effects, places_of(model))
    return [
        ("nominal", BEFORE, diagnosis.nominal.frequency_response(f, rate)[:, output, j]),
        ("extended", AFTER, extended.frequency_response(f, rate)[:, output, j]),
    ]


def _measured(diagnosis: Diagnosis, output: int) -> tuple[FrequencyResponse, int, int] | None:
    """Return the responses from all driven inputs, and that which moves `output` most: its column and its number."""
    data = diagnosis.data
    driven = np.flatnonzero(np.max([np.ptp(r.u, axis=0) for r in data.records], axis=0) > 0.0)
    if driven.size == 0:
        return None
    longest = max(r.n for r in data.records)
    piece = min(int(next_fast_len(max(longest // PIECES, 64), real=True)), MOST_ROWS) // 2 * 2
    records = [np.concatenate([r.u[:, driven], r.y], axis=1) for r in data.records]
    offset = np.concatenate(records).mean(axis=0)
    try:
        spectra = averaged_spectra(([x] for x in records), piece, offset.size, offset)
        response = spectra.response(data.rate_hz, driven.size, data.n_outputs, WEAKEST)
    except DataError:
        return None
    moved = data.u_scale()[driven] * np.median(np.abs(response.response[:, output]), axis=0)
    column = int(np.argmax(moved))
    return response, column, int(driven[column])


def _thinned_lines(f: Array, spread: Array) -> NDArray[np.intp]:
    """Return the numbers of the best-known line of each of `PER_DECADE` bands, of those that are known."""
    known = np.flatnonzero(spread < KNOWN)
    if known.size == 0:
        return known
    band = np.floor(PER_DECADE * np.log10(f[known])).astype(int)
    order = np.lexsort((spread[known], band))
    _, first = np.unique(band[order], return_index=True)
    return np.sort(known[order[first]])


def _degrees(response: ComplexArray) -> Array:
    return np.asarray(np.degrees(np.unwrap(np.angle(response))))
