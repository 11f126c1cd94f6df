"""The interactive plots of a diagnosis: the residual of any segment in time and frequency, the evidence of any run.

Everything is thinned to a budget, so that a page of hours of data can still be sent by mail; each plot says so itself.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from analysis.diagnosis.answer.figures import QUANTITIES, by_category, categories, is_steep, level_label
from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.records.dataset import Dataset, Window
from analysis.diagnosis.result import Domain
from analysis.pages.explorer import Explorer, Facts, Panel, Series, View
from analysis.pages.formats import without_exponents
from analysis.pages.quantities import LEAST_P, chance, scaled
from sim_backend.axis_names import axis_text, with_axes
from sim_backend.linear import Array
from sim_backend.model import Model, Port

SEGMENTS = 24
"""Segments that may be chosen, those first where the nominal model misses most."""

TIME_POINTS = 30_000
"""Points of all curves over time together: two thirds of a megabyte."""

LEAST_POINTS, MOST_POINTS = 300, 1500
EVIDENCE_POINTS = 30_000
LINES = 8192
"""Samples of one stretch of a spectrum; longer records give the mean over stretches that overlap by half."""

PER_DECADE = 60
_LEAST_ROWS = 16


@dataclass(frozen=True)
class _Segment:
    """One window of one record by its name on the page, and how far the nominal model misses there, in noise."""

    name: str
    record: int
    window: Window
    outputs: Array


def residual_explorer(
    data: Dataset,
    before: Sequence[Array],
    after: Sequence[Array],
    whitener: Whitener,
    noise_rms: Array,
    model: Model,
    files: Mapping[str, str],
) -> Explorer | None:
    """Return the residual before and after by segment and output, in time and frequency; None without segments.

    `before` and `after` are each record's residuals (n, n_y), `noise_rms` has shape (n_y,), `files` names the runs.
    """
    everything = _segments(data, before, noise_rms, files)
    segments = everything[:SEGMENTS]
    if not segments:
        return None
    worst = np.argsort(-np.max([s.outputs for s in everything], axis=0), kind="stable")
    names = distinct([axis_text(port.dof) for port in model.outputs])
    most = int(np.clip(TIME_POINTS // (3 * len(segments) * len(names)), LEAST_POINTS, MOST_POINTS))
    views: dict[tuple[str, ...], View] = {}
    for s in segments:
        rows = slice(s.window.start, s.window.stop)
        for o in worst:
            port, y = model.outputs[int(o)], data.records[s.record].y[rows, o]
            pair = {"adjusted": before[s.record][rows, o], "extended": after[s.record][rows, o]}
            factor, unit = scaled(float(np.max(np.abs(pair["adjusted"]))), port.unit)
            facts = _sizes(pair, float(noise_rms[o]), factor, unit)
            in_time = _in_time(pair, y, data.rate_hz, 2.0 * float(noise_rms[o]), port, factor, unit, most)
            views[s.name, names[o], "time"] = View(in_time, facts, _thinning(y.size, most))
            if y.size >= _LEAST_ROWS:
                noise = noise_density(whitener, int(o), data.rate_hz, LINES)
                panel = _in_frequency(pair, noise, data.rate_hz, factor, unit)
                views[s.name, names[o], "frequency"] = View((panel,), facts, "Shown without its mean.")
    return Explorer(
        "residual",
        "The residual of any segment",
        _remark(len(segments), len(everything)),
        {
            "segment": tuple(s.name for s in segments),
            "output": tuple(names[o] for o in worst),
            "over": ("time", "frequency"),
        },
        views,
    )


def evidence_explorer(
    before: Mapping[str, tuple[Domain, ...]],
    after: Mapping[str, tuple[Domain, ...]],
    model: Model,
    files: Mapping[str, str],
) -> Explorer | None:
    """Return the residual ÷ noise in every domain by run and output; None where nothing was looked at."""
    curves = [(name, d) for name, found in before.items() for d in found]
    if not curves:
        return None
    # the strongest evidence first: what is shown before anything is chosen is what matters most
    curves.sort(key=lambda one: (one[1].p_value, -float(np.max(one[1].level / one[1].floor))))
    runs = list(dict.fromkeys(d.record for _, d in curves))
    titles = dict(zip(runs, distinct([files.get(run, run) for run in runs]), strict=True))
    extended = {(name, d.record, d.output): d for name, found in after.items() for d in found}
    views: dict[tuple[str, ...], View] = {}
    left = EVIDENCE_POINTS
    for run in runs:
        mine = [(name, d) for name, d in curves if d.record == run]
        left -= sum(3 * d.axis.size for _, d in mine)
        if left < 0 and views:
            break
        for name, d in mine:
            chosen = titles[run], axis_text(d.output), f"by {name}"
            views[chosen] = _by_domain(name, d, extended.get((name, d.record, d.output)), model)
    shown = list(dict.fromkeys(chosen[0] for chosen in views))
    rest = (
        f" Shown are the {len(shown)} of {len(runs)} runs with the strongest evidence."
        if len(shown) < len(runs)
        else ""
    )
    return Explorer(
        "evidence",
        "The evidence of any run",
        f"The residual in units of the noise, whose floor is 1; the strongest evidence comes first.{rest}",
        {
            "run": tuple(shown),
            "output": tuple(dict.fromkeys(chosen[1] for chosen in views)),
            "domain": tuple(dict.fromkeys(chosen[2] for chosen in views)),
        },
        views,
    )


def distinct(names: Sequence[str]) -> list[str]:
    """Return names with a number behind each that occurs again."""
    seen: Counter[str] = Counter()
    out: list[str] = []
    for name in names:
        seen[name] += 1
        again = name if seen[name] == 1 else f"{name} ({seen[name]})"
        while again in out:
            again += "′"
        out.append(again)
    return out


def density(x: Array, rate_hz: float) -> tuple[Array, Array]:
    """Return frequency (bands,) in Hz and amplitude density (bands,) per √Hz, one-sided, of `x` (n,) about its mean.

    Welch's estimate with a Hann window, its mean over logarithmic bands.
    """
    f, power = scipy.signal.welch(x, rate_hz, nperseg=min(x.size, LINES), detrend="constant")
    return _banded(f[1:], power[1:])


def noise_density(whitener: Whitener, output: int, rate_hz: float, lines: int) -> tuple[Array, Array]:
    """Return what `density` does, (bands,) each, for noise that a whitener makes white, in bins of `lines` samples."""
    part = np.arange(1, lines // 2 + 1) / lines
    taps = whitener.taps[output]
    gain = np.abs(np.exp(-2j * np.pi * np.outer(part, np.arange(taps.size))) @ taps)
    power = 2.0 / rate_hz / np.maximum(gain, np.finfo(float).tiny) ** 2
    return _banded(part * rate_hz, power * whitener.bands.at(part)[output])


def _banded(f: Array, power: Array) -> tuple[Array, Array]:
    band = np.floor(PER_DECADE * np.log10(f / f[0])).astype(np.int64)
    count = np.bincount(band)
    full = count > 0
    centre, mean = (np.bincount(band, weights=x)[full] / count[full] for x in (f, power))
    return np.asarray(centre), np.sqrt(mean)


def _segments(data: Dataset, before: Sequence[Array], noise_rms: Array, files: Mapping[str, str]) -> list[_Segment]:
    titles = [f"{files.get(data.records[i].name, data.records[i].name)}: {w.label}" for i, w in data.windows]
    size = np.where(noise_rms > 0.0, noise_rms, 1.0)
    found = [
        _Segment(
            f"{name} (held out)" if w.held_out and "held-out" not in w.label else name,
            i,
            w,
            np.sqrt(np.mean(before[i][w.start : w.stop] ** 2, axis=0)) / size,
        )
        for name, (i, w) in zip(distinct(titles), data.windows, strict=True)
    ]
    return sorted(found, key=lambda s: -float(np.max(s.outputs)))


def _sizes(pair: Mapping[str, Array], noise: float, factor: float, unit: str) -> Facts:
    rows: list[tuple[str, tuple[float | None, ...]]] = []
    for name, x in pair.items():
        rms = float(np.sqrt(np.mean(x**2)))
        rows.append((name, (rms * factor, float(np.max(np.abs(x))) * factor, rms / noise if noise > 0.0 else None)))
    rows.append(("noise floor", (noise * factor, None, 1.0)))
    return Facts(("model", f"rms ({unit})", f"largest ({unit})", "rms ÷ noise"), tuple(rows))


def _in_time(
    pair: Mapping[str, Array], y: Array, rate_hz: float, reach: float, port: Port, factor: float, unit: str, most: int
) -> tuple[Panel, ...]:
    time_s = np.arange(y.size) / rate_hz
    band = (-reach * factor, reach * factor, "noise floor, ±2σ")
    size, output_unit = scaled(float(np.max(np.abs(y))), port.unit)
    x = "time in the segment (s)"
    series = tuple(Series.of(name, time_s, e * factor, most=most) for name, e in pair.items())
    measured = Series.of("measured", time_s, y * size, most=most, colour="ink")
    return (
        Panel(x, f"measured − simulated ({unit})", series, band=band, band_colour="quiet"),
        Panel(x, f"{axis_text(port.dof)}, measured ({output_unit})", (measured,)),
    )


def _in_frequency(
    pair: Mapping[str, Array], noise: tuple[Array, Array], rate_hz: float, factor: float, unit: str
) -> Panel:
    curves = {name: density(e, rate_hz) for name, e in pair.items()} | {"noise floor": noise}
    lowest = float(curves["adjusted"][0][0])
    series = []
    for name, (f, level) in curves.items():
        seen = (level > 0.0) & (f >= lowest)
        series.append(Series.of(name, f[seen], level[seen] * factor, colour="quiet" if name == "noise floor" else ""))
    return Panel("frequency (Hz)", f"residual ({unit}/√Hz)", tuple(series), log_x=True, log_y=True)


def _by_domain(name: str, first: Domain, second: Domain | None, model: Model) -> View:
    bars = by_category(name)
    factor, unit = (1.0, "") if bars else scaled(float(np.max(np.abs(first.axis))), first.unit)
    pairs = [("adjusted", first)] + ([("extended", second)] if second is not None else [])
    log_x, log_y = name == "frequency", is_steep(first)
    series: list[Series] = []
    rows: list[tuple[str, tuple[float | str | None, ...]]] = []
    for label, d in pairs:
        x = np.arange(d.axis.size, dtype=float) if bars else d.axis * factor
        seen = (d.level > 0.0) & ((x > 0.0) | (not log_x))
        series.append(Series.of(label, x[seen], d.level[seen], "bars" if bars else "line"))
        p = float(d.p_value)
        rows.append((label, (float(np.max(d.level / d.floor)), "< 10⁻¹²" if p < LEAST_P else p)))
    ends = (
        np.array([-0.5, first.axis.size - 0.5]) if bars else series[0].x[[0, -1]] if series[0].x.size else np.zeros(2)
    )
    series.append(Series.of("noise floor", ends, np.full(2, float(np.mean(first.floor))), colour="quiet"))
    panel = Panel(
        f"{QUANTITIES[name]}{f' ({unit})' if unit else ''}",
        level_label(name),
        tuple(series),
        log_x=log_x,
        log_y=log_y,
        names=categories(name, first, model) if bars else None,
    )
    where = with_axes(without_exponents(f"{first.where} ({chance(first.p_value)})."))
    return View((panel,), Facts(("model", "highest ÷ noise", "p-value"), tuple(rows)), where)


def _thinning(rows: int, most: int) -> str:
    if rows <= most:
        return f"All {rows} samples are drawn."
    return f"Of {rows} samples the smallest and the largest of every {-(-2 * rows // most)} are drawn."


def _remark(shown: int, of: int) -> str:
    which = "" if shown == of else f" The {shown} of {of} segments are listed where it misses most."
    return (
        "“Adjusted” is the given model with its own numbers fitted; the segment where it misses most comes first."
        f"{which} Shaded: the noise floor, ±2σ."
    )
