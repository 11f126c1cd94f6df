"""The figures of a diagnosis: measured and simulated, the response, and the residual in time and in every domain."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from analysis.diagnosis.records.dataset import Dataset
from analysis.diagnosis.result import Diagnosis, Domain
from analysis.frequency.averaged_spectra import averaged_spectra
from analysis.frequency.frf import FrequencyResponse
from analysis.linear.predicted import Predictor, changes_the_response
from analysis.pages.bode import bode_canvas, per, scale_axes
from analysis.pages.canvas import COLOURS, INK, QUIET, Canvas, thinned
from analysis.pages.quantities import chance, scaled
from sim_backend.assembly import places_of, stated
from sim_backend.axis_names import axis_text
from sim_backend.effects.base import Effect, Site
from sim_backend.errors import DataError
from sim_backend.linear import Array, ComplexArray
from sim_backend.model import Model

if TYPE_CHECKING:
    from matplotlib.axes import Axes


BEFORE, AFTER, GIVEN = COLOURS[:3]
"""The adjusted and the extended model as in the interactive plots, whose colours follow the order, and the given."""

MEASURED, NOISE = INK, QUIET
"""What was measured, and the noise: in every figure of the page the same."""

DOTS: dict[str, Any] = {"color": MEASURED, "marker": ".", "markersize": 2.5}
"""How a measured response is drawn."""

MOST_POINTS = 1500
"""Longest curve of a figure: each stretch of a longer one is drawn with its least and its greatest value."""

SIZE = (3.2, 2.4)
"""Three beside each other on a desk, where a point is 1.4 pixels; on a telephone it is 1.5."""

WIDE = 3.7
"""Width of a figure that has half of a desk; on a telephone a point of it is 1.3 pixels."""

_FEW_DECADES = (3.0, 1.5)
"""Logarithmic axes of x and of y up to so many decades have their numbers at 1, 2 and 5."""

_EVEN_RATIO = 3.0
"""Ratios that differ by less are drawn on a linear axis."""

STEEP = 20.0

QUANTITIES = {
    "frequency": "frequency",
    "amplitude": "amplitude of the motion (moving rms)",
    "position": "position",
    "direction": "direction of motion",
    "rate": "rate",
    "time": "time",
    "temperature": "temperature",
    "cross-axis": "other axis",
    "level": "level of excitation",
}

SWINGS = 8
"""Swings of the measured output that are drawn: more would overlap."""

SCALED_APART = 10.0
"""A curve so many times smaller than the one beside it has a panel of its own, in which it can be seen."""

PIECES = 5
"""Half-overlapping segments of the longest record: more of them lower the noise and coarsen the frequency bins."""

MOST_ROWS = 16384

WEAKEST = 1e-6
"""Part of the strongest bin's power below which an input says nothing of the response there."""

KNOWN = 0.1
"""Largest standard deviation of a point that is drawn, relative to the response."""

LEAST_POINTS = 12

PER_DECADE = 60

CURVE_POINTS = 500


@dataclass(frozen=True)
class Drawn:
    """One finished figure: its name in files, what it shows, and its canvas."""

    name: str
    title: str
    caption: str
    canvas: Canvas


def residual_figures(
    data: Dataset, before: Sequence[Array], after: Sequence[Array], noise_rms: Array, model: Model
) -> list[Drawn]:
    """Return, per output, the residual in time of the segment where it was largest, before and after.

    Residuals are (n, n_y) per record, `noise_rms` (n_y,) in units of the outputs.
    """
    drawn = []
    names = file_names([port.dof for port in model.outputs])
    for o, port in enumerate(model.outputs):
        i, w = max(
            data.windows,
            key=lambda place: float(np.mean(before[place[0]][place[1].start : place[1].stop, o] ** 2)),
        )
        old, new = (x[i][w.start : w.stop, o] for x in (before, after))
        factor, unit = scaled(float(np.max(np.abs(old))), port.unit)
        name = axis_text(port.dof)
        canvas = Canvas(f"Residual of {name}", "", size=SIZE)
        canvas.panel(0, name, "time in the segment (s)", f"measured − simulated ({unit})")
        time_s = np.arange(w.stop - w.start) / data.rate_hz
        canvas.line(0, "adjusted", *thinned(time_s, old * factor, MOST_POINTS), color=BEFORE, linewidth=0.9)
        canvas.line(0, "extended", *thinned(time_s, new * factor, MOST_POINTS), color=AFTER, linewidth=0.9)
        two_sigma = 2.0 * float(noise_rms[o]) * factor
        canvas.band(0, -two_sigma, two_sigma, "noise floor, ±2σ")
        canvas.legend_above(0)
        held = ", which no fit has seen" if w.held_out else ""
        step = -(-2 * time_s.size // MOST_POINTS) if time_s.size > MOST_POINTS else 1
        drawn_of = f" Of every {step} samples the smallest and the largest are drawn." if step > 1 else ""
        caption = f"{name} in segment “{w.label}”{held}: where the adjusted model misses most.{drawn_of}"
        drawn.append(Drawn(f"residual-{names[o]}", f"Residual of {name}", caption, canvas))
    return drawn


def file_names(names: Sequence[str]) -> list[str]:
    """Return names for files and for elements of a page: letters, digits, `_` and `-` alone, each different."""
    plain = [re.sub(r"[^A-Za-z0-9_-]+", "_", name)[:64] for name in names]
    return plain if len(set(plain)) == len(plain) else [f"{i}-{name}" for i, name in enumerate(plain, start=1)]


def evidence_figures(
    before: dict[str, tuple[Domain, ...]], after: dict[str, tuple[Domain, ...]], model: Model
) -> list[Drawn]:
    """Return one figure per domain: the run and output with the strongest evidence, before and after."""
    drawn = []
    for name, curves in before.items():
        if not curves:
            continue
        # p-values run into zero; then the higher peak decides
        worst = min(curves, key=lambda d: (d.p_value, -float(np.max(d.level))))
        same = [d for d in after.get(name, ()) if (d.record, d.output) == (worst.record, worst.output)]
        canvas = _drawn(name, worst, same[0] if same else None, model)
        drawn.append(Drawn(f"evidence-{name}", f"By {name}", f"{worst.where} ({chance(worst.p_value)}).", canvas))
    return drawn


def by_category(name: str) -> bool:
    """Tell whether a domain has names along its axis instead of a quantity."""
    return name in ("direction", "cross-axis")


def categories(name: str, domain: Domain, model: Model) -> tuple[str, ...]:
    """Return the names along the axis of a domain by category."""
    return ("down", "up") if name == "direction" else tuple(axis_text(model.outputs[int(k)].dof) for k in domain.axis)


def level_label(name: str) -> str:
    """Return what the levels of a domain are."""
    return "what follows ÷ noise" if name == "cross-axis" else "residual ÷ noise"


def is_steep(domain: Domain) -> bool:
    """Tell whether a curve rises so far above the noise that only a logarithmic axis shows both."""
    return float(np.max(domain.level)) > STEEP * float(np.mean(domain.floor))


def _drawn(name: str, first: Domain, second: Domain | None, model: Model) -> Canvas:
    factor, unit = (1.0, "") if by_category(name) else scaled(float(np.max(np.abs(first.axis))), first.unit)
    canvas = Canvas(name, "", size=SIZE)
    canvas.panel(0, axis_text(first.output), f"{QUANTITIES[name]}{f' ({unit})' if unit else ''}", level_label(name))
    if by_category(name):
        _as_bars(canvas, first, second, categories(name, first, model))
    else:
        _as_curves(canvas, first, second, factor)
        if name == "frequency":
            canvas.axes[0].set_xscale("log")
            finer_ticks(canvas.axes[0])
    _floor(canvas, first, second)
    canvas.legend_above(0)
    return canvas


def _as_curves(canvas: Canvas, first: Domain, second: Domain | None, factor: float) -> None:
    for label, curve, colour, mark in (("adjusted", first, BEFORE, "o"), ("extended", second, AFTER, "s")):
        if curve is not None:
            canvas.line(0, label, curve.axis * factor, curve.level, color=colour, marker=mark, markersize=2.2)


def _as_bars(canvas: Canvas, first: Domain, second: Domain | None, names: Sequence[str]) -> None:
    at = np.arange(first.axis.size, dtype=float)
    for label, curve, colour, shift in (("adjusted", first, BEFORE, -0.2), ("extended", second, AFTER, 0.2)):
        if curve is not None:
            canvas.bars(0, label, at + shift, curve.level, 0.38, color=colour)
    canvas.axes[0].set_xticks(at, names, parse_math=False)
    canvas.axes[0].grid(axis="x", visible=False)


def _floor(canvas: Canvas, first: Domain, second: Domain | None) -> None:
    axes: Axes = canvas.axes[0]
    level = float(np.mean(first.floor))
    top = max(level, *(float(np.max(curve.level)) for curve in (first, second) if curve is not None))
    if is_steep(first):
        axes.set_yscale("log")
        from matplotlib.ticker import FuncFormatter  # see `analysis.pages.canvas`

        axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
        axes.set_ylim(bottom=0.4 * level)
    else:
        axes.set_ylim(0.0, 1.15 * max(top, 1.3 * level))
    axes.axhline(level, color=NOISE, linewidth=1.0, linestyle=(0, (4, 3)), label="noise floor")


def swing_rows(y: Array) -> int:
    """Return the mean length in samples of one swing of `y` (n,) about its mean; half of all where none ends."""
    about = y - y.mean()
    # half the rms on either side: what crosses by noise alone is no swing
    beyond = np.sign(about)[np.abs(about) > 0.5 * float(np.std(y))]
    turns = int(np.count_nonzero(np.diff(beyond)))
    return max(2 * y.size // max(turns, 4), 1)


def bode_figure(diagnosis: Diagnosis, model: Model, output: int) -> Drawn | None:
    """Return the response of `output` to the input that drives it most: magnitude, phase, and magnitude ÷ as given.

    None where the records determine no linear response: the inputs never move independently, or too few frequency bins
    are above the noise.
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
    one, other = axis_text(source.dof), axis_text(target.dof)
    title = other if one == other else f"{one} → {other}"
    unit = per(target.unit, source.unit)
    canvas = bode_canvas(f"Frequency response {title}", title, unit, (WIDE, 4.6), rows=3)
    canvas.panel(2, "", "frequency (Hz)", "magnitude ÷ as given")
    curve_f = np.geomspace(f[good[0]], f[good[-1]], CURVE_POINTS)
    models = _models(diagnosis, model, curve_f, output, j)
    # of all whole turns the one nearest to the given model, which has no gaps between its frequencies
    near = np.interp(f[good], curve_f, _degrees(models[0][2]))
    canvas.points(0, "measured", f[good], np.abs(g[good]), **DOTS)
    turned = near + np.degrees(np.angle(g[good] * np.exp(-1j * np.radians(near))))
    canvas.points(1, "measured", f[good], turned, **DOTS)
    (_, _, given), *_ = _models(diagnosis, model, f[good], output, j)
    ratios = [np.abs(g[good]) / np.maximum(np.abs(given), 1e-300)]
    canvas.points(2, "measured", f[good], ratios[0], **DOTS)
    for name, colour, values in models:
        canvas.line(0, name, curve_f, np.abs(values), color=colour, linewidth=1.1)
        canvas.line(1, name, curve_f, _degrees(values), color=colour, linewidth=1.1)
        ratios.append(np.abs(values) / np.maximum(np.abs(models[0][2]), 1e-300))
        canvas.line(2, name, curve_f, ratios[-1], color=colour, linewidth=1.1)
    scale_axes(canvas)
    _scale_ratio(canvas.axes[2], np.concatenate(ratios))
    for axes in canvas.axes:
        finer_ticks(axes)
    canvas.axes[1].yaxis.set_major_locator(MultipleLocator(90.0))
    canvas.legend_outside()
    caption = _bode_caption(f"{other} to the input {source.name}", [name for name, *_ in models])
    return Drawn("bode", canvas.title, caption, canvas)


def _bode_caption(what: str, models: Sequence[str]) -> str:
    adjusted = " and with its own numbers adjusted" if "adjusted" in models else ""
    extended = (
        ", and the linear part of the extended one, found gains and delays included" if "extended" in models else ""
    )
    return (
        f"Response of {what}: measured (averaged spectra of all records; frequencies where it is known to "
        f"{100.0 * KNOWN:.0f} % or better), the model as given{adjusted}{extended}. What depends on amplitude "
        "shows here as a mean over what was played. Below: each divided by the model as given, where small differences "
        "are seen."
    )


def _scale_ratio(axes: Axes, ratios: Array) -> None:
    """Draw ratios near one on a linear axis, others on a logarithmic one."""
    known = ratios[np.isfinite(ratios) & (ratios > 0.0)]
    axes.set_yscale("linear" if known.max() < _EVEN_RATIO * known.min() else "log")


def finer_ticks(axes: Axes) -> None:
    """Number the logarithmic axes of `axes`, once everything is drawn, at 1, 2 and 5 where they are short."""
    from matplotlib.ticker import LogLocator  # see `analysis.pages.canvas`

    for axis, most in zip((axes.xaxis, axes.yaxis), _FEW_DECADES, strict=True):
        low, high = axis.get_view_interval()
        if axis.get_scale() == "log" and high < low * 10.0**most:
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12))


def _models(diagnosis: Diagnosis, model: Model, f: Array, output: int, j: int) -> list[tuple[str, str, ComplexArray]]:
    """Return name, colour and response (n,) of every model that is drawn: as given first."""
    predictor = Predictor(places_of(model), f, diagnosis.data.rate_hz)
    # effects of the file that act on its linear part are in the fitted parts already
    given = [e for e in stated(model.effects) if _linear(e)]
    kept = [e for e in given if e.site is not Site.MODEL]
    found = [e for e in diagnosis.effects if _linear(e)]
    shown = [("as given", GIVEN, predictor.response(diagnosis.nominal, given))]
    if diagnosis.adjusted is not None:
        shown.append(("adjusted", BEFORE, predictor.response(diagnosis.adjusted, kept)))
    if diagnosis.effects or diagnosis.adjusted is None:
        shown.append(("extended", AFTER, predictor.response(diagnosis.linear, [*kept, *found])))
    return [(name, colour, response[:, output, j]) for name, colour, response in shown]


def _linear(effect: Effect) -> bool:
    return effect.site is Site.MODEL or changes_the_response(type(effect))


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
    """Return the numbers of the best-known bin of each of `PER_DECADE` bands, of those that are known."""
    known = np.flatnonzero(spread < KNOWN)
    if known.size == 0:
        return known
    band = np.floor(PER_DECADE * np.log10(f[known])).astype(int)
    order = np.lexsort((spread[known], band))
    _, first = np.unique(band[order], return_index=True)
    return np.sort(known[order[first]])


def _degrees(response: ComplexArray) -> Array:
    return np.asarray(np.degrees(np.unwrap(np.angle(response))))
