"""The picture in which a named cause is seen: the force that the linear model lacks, over what it depends on.

The residual of the linear part of the extended model is converted to the force that would cause it, by the inverse of
the plant where the plant is above the noise (Wiener's filter). Measured and modelled force pass through the same
filter, so that they can be compared. Only the middle of a stretch is drawn, which its ends do not affect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from analysis.diagnosis.answer.explore import noise_density
from analysis.diagnosis.answer.figures import AFTER, MEASURED, SWINGS, WIDE, Drawn, swing_rows
from analysis.diagnosis.evidence.bins import rate_of
from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.nominal.responses import simulate
from analysis.diagnosis.records.dataset import Window
from analysis.diagnosis.result import Diagnosis
from analysis.pages.canvas import Canvas
from analysis.pages.quantities import scaled, share
from sim_backend.axis_names import axis_text, with_axes
from sim_backend.effects.base import Effect, Site
from sim_backend.effects.words import placed_text
from sim_backend.linear import Array, played
from sim_backend.model import Model

SIZE = (WIDE, 3.0)
MOST_ROWS = 32768
SHOWN_POINTS = 1200
BINS = 30
LINES = 8192

SEEN = 0.3
"""Part of a force's variance that one quantity has to explain for a picture over it to show anything."""

SMOOTHED = 9
"""Neighbouring frequency bins whose mean power is compared with that of the noise."""

LOOP_SWINGS, LEAST_LOOP = 2, 32
"""Swings of a loop that are drawn, and the fewest samples that show one."""

LOOPS, RATES = ("hysteresis", "backlash"), ("friction",)
"""Parts of the names of effects that are seen in a loop over the position, and over the rate."""


@dataclass(frozen=True)
class Quantity:
    """Something that a force may depend on: what it is, its unit, its values (n,); `own` where the effect acts."""

    kind: str
    label: str
    unit: str
    values: Array
    own: bool = True


@dataclass(frozen=True)
class _Missing:
    """What the linear model lacks in the middle of a stretch: measured and modelled (n,), unit, and what that is."""

    measured: Array
    modelled: Array
    unit: str
    label: str
    rows: slice


def mechanism_figure(diagnosis: Diagnosis, model: Model, whitener: Whitener) -> Drawn | None:
    """Return the force (or reading) that the linear model lacks over what it depends on; None where nothing shows it.

    Hysteresis and backlash are drawn over the position, friction over the rate, anything else over the quantity that
    explains most of it: one of the effect's own degree of freedom if that explains enough.
    """
    effect = _shown_effect(diagnosis)
    if effect is None:
        return None
    place = _place(diagnosis, model, effect)
    if place is None:
        return None
    i, window, o, j = place
    missing = _missing(diagnosis, model, whitener, effect, i, window, o, j)
    if missing is None:
        return None
    chosen = drawn_over(effect, missing.modelled, _quantities(diagnosis, model, i, missing.rows, o, j))
    if chosen is None:
        return None
    return _drawn(missing, *chosen, effect, window)


def _shown_effect(diagnosis: Diagnosis) -> Effect | None:
    """Return the effect of the first cause, of the best hypothesis where causes are tied; None without one."""
    for cause in diagnosis.causes:
        for effect in diagnosis.effects:
            if (effect.reported(), effect.where) == (cause.effect, cause.where):
                return effect
    return diagnosis.effects[0] if diagnosis.effects else None


def _place(diagnosis: Diagnosis, model: Model, effect: Effect) -> tuple[int, Window, int, int | None] | None:
    """Return record, window, output and input (None: no force) in which an effect is largest, held out if there are.

    None for a force that moves no output alone: what several inputs do to one output does not show its law.
    """
    target = effect.where.rpartition("->")[2]
    outputs, inputs = [p.dof for p in model.outputs], [p.dof for p in model.inputs]
    changed = [b - a for b, a in zip(diagnosis.before, diagnosis.after, strict=True)]
    windows = diagnosis.data.judged
    if not windows:
        return None
    size = np.array([np.sum(changed[i][w.start : w.stop] ** 2, axis=0) for i, w in windows])
    o = outputs.index(target) if target in outputs else int(np.argmax(size.max(axis=0)))
    i, window = windows[int(np.argmax(size[:, o]))]
    if effect.site in (Site.HEAD, Site.READING, Site.RECORD):
        return i, window, o, None
    if outputs[o] in inputs:
        return i, window, o, inputs.index(outputs[o])
    return (i, window, o, 0) if inputs == [target] else None


def _missing(
    diagnosis: Diagnosis,
    model: Model,
    whitener: Whitener,
    effect: Effect,
    i: int,
    window: Window,
    o: int,
    j: int | None,
) -> _Missing | None:
    record, rate = diagnosis.data.records[i], diagnosis.data.rate_hz
    linear = diagnosis.linear
    plant = played(linear, rate)
    foretold = simulate(plant, record.u)[:, o]
    first = max(window.start, window.stop - MOST_ROWS)
    rows = slice(first, window.stop)
    left = [(x - foretold)[rows] for x in (record.y[:, o], record.y[:, o] - diagnosis.after[i][:, o])]
    n = left[0].size
    if n < 4 * SMOOTHED:
        return None
    middle = slice(n // 4, n - n // 4)
    shown = slice(first + middle.start, first + middle.stop)
    port = model.outputs[o]
    if j is None:
        return _Missing(left[0][middle], left[1][middle], port.unit, "reading that the linear model lacks", shown)
    if effect.site not in (Site.COMMAND, Site.CURRENT):
        plant = played(linear.with_(delay_s=np.zeros_like(linear.delay_s)), rate)  # a force there passes no amplifier
    f: Array = np.fft.rfftfreq(n, 1.0 / rate)[1:].astype(float)
    gain = plant.frequency_response(f)[:, o, j]
    taper = scipy.signal.windows.tukey(n, 0.5)
    weight = _above_noise(left[1] * taper, whitener, o, rate, float(np.sum(taper**2)))
    inverse = np.divide(weight, gain, out=np.zeros_like(gain), where=np.abs(gain) > 0.0)
    measured, modelled = (
        np.fft.irfft(np.concatenate([[0.0], np.fft.rfft(x * taper)[1:] * inverse]), n)[middle] for x in left
    )
    unit = model.inputs[j].unit
    return _Missing(
        measured, modelled, unit, f"{'torque' if unit == 'N m' else 'force'} that the linear model lacks", shown
    )


def _above_noise(x: Array, whitener: Whitener, o: int, rate_hz: float, energy: float) -> Array:
    """Return, in every bin but the first, which part of the power is that of `x` (n,) and not noise (Wiener's filter).

    `x` is what the extended model says. It has no noise of its own, so it shows where the measurement is above the
    noise.
    """
    power = np.abs(np.fft.rfft(x)[1:]) ** 2
    f = np.fft.rfftfreq(x.size, 1.0 / rate_hz)[1:]
    at, density = noise_density(whitener, o, rate_hz, LINES)
    noise = np.interp(f, at, density) ** 2 * 0.5 * rate_hz * energy
    smooth = scipy.ndimage.uniform_filter1d(power, SMOOTHED, mode="nearest")
    return np.asarray(smooth / np.maximum(smooth + noise, np.finfo(float).tiny))


def _quantities(diagnosis: Diagnosis, model: Model, i: int, rows: slice, o: int, j: int | None) -> list[Quantity]:
    """Return everything that a force may be drawn over, as the extended model says that it was."""
    record, rate = diagnosis.data.records[i], diagnosis.data.rate_hz
    moved = record.y - diagnosis.after[i]
    out = [
        Quantity("position", f"position of {axis_text(p.dof)}", p.unit, moved[rows, k], own=k == o)
        for k, p in sorted(enumerate(model.outputs), key=lambda one: one[0] != o)
    ]
    own = model.outputs[o]
    out.append(Quantity("rate", f"rate of {axis_text(own.dof)}", f"{own.unit}/s", rate_of(moved[:, o], rate)[rows]))
    out += [
        Quantity("command", f"command of {axis_text(p.dof)}", p.unit, record.u[rows, k], own=k == j)
        for k, p in sorted(enumerate(model.inputs), key=lambda one: one[0] != j)
    ]
    if record.temperature_k is not None:
        out.append(Quantity("temperature", "temperature", "K", record.temperature_k[rows]))
    out.append(Quantity("time", "time in the record", "s", np.arange(rows.start, rows.stop) / rate))
    return out


def drawn_over(effect: Effect, force: Array, among: Sequence[Quantity]) -> tuple[Quantity, float] | None:
    """Return over what a `force` (n,) is drawn, and the part of its variance that this explains; None for no force."""
    if not np.any(force):
        return None
    name = effect.reported()
    wanted = ""
    if any(part in name for part in LOOPS):
        wanted = "command" if effect.site is Site.COMMAND else "position"
    elif any(part in name for part in RATES):
        wanted = "rate"
    found = [(q, explained(q.values, force)) for q in among if q.kind == wanted or not wanted]
    if wanted:
        return found[0]
    # what moves together with the own degree of freedom may explain a little more by chance
    for candidates in ([one for one in found if one[0].own], found):
        best = max(candidates, key=lambda one: one[1])
        if best[1] >= SEEN:
            return best
    return None


def explained(x: Array, force: Array) -> float:
    """Return which part of the variance of `force` (n,) its mean in bins of `x` (n,) explains, from 0 to 1."""
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, BINS + 1)))
    if edges.size < 3 or not np.var(force) > 0.0:
        return 0.0
    index = np.searchsorted(edges[1:-1], x, side="right")
    count = np.bincount(index, minlength=edges.size - 1)
    mean = np.bincount(index, weights=force, minlength=count.size) / np.maximum(count, 1)
    return float(1.0 - np.var(force - mean[index]) / np.var(force))


def _drawn(missing: _Missing, over: Quantity, part: float, effect: Effect, window: Window) -> Drawn:
    acts = missing.label
    if _looped(effect):
        acts = f"{missing.label.partition(' ')[0]} less its linear part"
        missing = _without_slope(missing, over)
    rows = _busiest(over.values, missing.modelled, looped=_looped(effect))
    x, size = over.values[rows], float(np.max(np.abs(over.values[rows])))
    factor, x_unit = scaled(size, over.unit)
    measured, modelled = missing.measured[rows], missing.modelled[rows]
    scale, unit = scaled(float(np.max(np.abs(modelled))), missing.unit)
    every = -(-x.size // SHOWN_POINTS)
    canvas = Canvas(with_axes(placed_text(effect, effect.where)), "", size=SIZE)
    canvas.panel(0, canvas.title, f"{over.label} ({x_unit})", f"{acts} ({unit})")
    at = x[::every] * factor
    if over.kind in ("position", "command") and _looped(effect):
        canvas.line(0, "extended model", at, modelled[::every] * scale, color=AFTER, linewidth=1.2)
    else:  # the model is a cloud as well: larger points below those that were measured
        canvas.points(0, "extended model", at, modelled[::every] * scale, color=AFTER, markersize=4.5, alpha=0.5, mew=0)
    canvas.points(0, "measured", at, measured[::every] * scale, color=MEASURED, marker=".", markersize=1.8, alpha=0.7)
    canvas.legend(0, loc="best")
    held = ", which no fit has seen" if window.held_out else ""
    told = (
        ""
        if _looped(effect)
        else f" Of the extended model's variance, {share(part)} is a function of {over.label}; the rest depends on "
        "something else, or comes from the conversion, which leaves out what the noise hides."
    )
    caption = (
        f"The {missing.label}, in segment “{window.label}”{held}: the measured residual converted into what would "
        f"make it, where it stands above the noise, and the same of the extended model.{told}"
    )
    return Drawn("mechanism", canvas.title, caption, canvas)


def _without_slope(missing: _Missing, over: Quantity) -> _Missing:
    """Return measured and modelled force less what of the modelled one is in proportion to a quantity.

    A spring that slips is a spring until it does, beside whose straight line its loops are too thin to be seen.
    """
    slope, offset = np.polyfit(over.values, missing.modelled, 1)
    line = slope * over.values + offset
    label = f"{missing.label}, less its part in proportion to the {over.kind}"
    return replace(missing, measured=missing.measured - line, modelled=missing.modelled - line, label=label)


def _looped(effect: Effect) -> bool:
    return any(part in effect.reported() for part in LOOPS)


def _busiest(x: Array, force: Array, *, looped: bool) -> slice:
    """Return the samples of a few swings of `x` (n,) where `force` (n,) is largest: more would hide each other.

    Loops hide each other sooner than points, and are drawn as lines: of those only `LOOP_SWINGS`.
    """
    swing = swing_rows(x)
    length = min(max(LOOP_SWINGS * swing, LEAST_LOOP) if looped else max(SWINGS * swing, SHOWN_POINTS), x.size)
    total = np.concatenate([[0.0], np.cumsum(force**2)])
    begin = int(np.argmax(total[length:] - total[:-length]))
    return slice(begin, begin + length)
