"""What a diagnosis opens with: measured and simulated over each other, and how sure the answer is and why not surer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.answer.figures import AFTER, BEFORE, Drawn
from analysis.diagnosis.answer.sentence import SIGNIFICANT
from analysis.diagnosis.records.dataset import Dataset, Window
from analysis.diagnosis.result import Diagnosis
from analysis.diagnosis.verdict.outstanding import least_by_chance
from analysis.pages.canvas import QUIET, Canvas, thinned
from analysis.pages.formats import readable
from analysis.pages.quantities import chance, scaled, share
from sim_backend.model import Model

Array = NDArray[np.float64]

SIZE = (4.8, 3.9)

SWINGS = 8
"""Swings of the measured output that are drawn: more would lie on each other."""

LEAST_ROWS = 200
MOST_POINTS = 1500

FAR_LESS = 5
"""Powers of ten from which on the number before them says nothing more."""


@dataclass(frozen=True)
class Surety:
    """How sure a diagnosis is, in words, and the reasons why it is not surer."""

    how: tuple[str, ...]
    why_not: tuple[str, ...]


@dataclass(frozen=True)
class _Stretch:
    """Rows of one output of one record."""

    record: int
    window: Window
    output: int
    rows: slice


def opening_figure(
    data: Dataset, before: Sequence[Array], after: Sequence[Array], noise_rms: Array, model: Model
) -> Drawn | None:
    """Return measured and simulated over each other where the nominal model misses most, held-out rows if there are.

    `before` and `after` are each record's residuals (n, n_y), `noise_rms` has shape (n_y,). None without a window.
    """
    place = _worst(data, before, noise_rms)
    if place is None:
        return None
    record, port = data.records[place.record], model.outputs[place.output]
    y = record.y[place.rows, place.output]
    old, new = (x[place.record][place.rows, place.output] for x in (before, after))
    pairs = [("nominal", old, BEFORE)] + ([] if np.array_equal(old, new) else [("extended", new, AFTER)])
    time_s = (np.arange(place.rows.start, place.rows.stop) - place.window.start) / data.rate_hz
    canvas = Canvas(f"Measured and simulated, {port.dof}", "", rows=2, size=SIZE, share_x=True)
    size, unit = scaled(float(np.max(np.abs(y))), port.unit)
    canvas.panel(0, port.dof, "", f"position ({unit})" if port.unit in ("rad", "m") else f"output ({unit})")
    canvas.line(0, "measured", *thinned(time_s, y * size, MOST_POINTS), color=QUIET, linewidth=3.0, alpha=0.55)
    factor, small = scaled(float(np.max(np.abs(old))), port.unit)
    canvas.panel(1, "", "time in the segment (s)", f"measured − simulated ({small})")
    for name, left, colour in pairs:
        canvas.line(0, name, *thinned(time_s, (y - left) * size, MOST_POINTS), color=colour, linewidth=1.1)
        canvas.line(1, name, *thinned(time_s, left * factor, MOST_POINTS), color=colour, linewidth=0.9)
    reach = 2.0 * float(noise_rms[place.output]) * factor
    canvas.band(1, -reach, reach, "noise, ±2σ")
    for i in range(2):
        canvas.legend_above(i, 4)
    unseen = ", which no fit has seen" if place.window.held_out else ""
    caption = (
        f"{port.dof} in segment “{place.window.label}”{unseen}: the stretch where the nominal model misses most, its "
        "own numbers adjusted."
    )
    return Drawn("measured-and-simulated", canvas.title, caption, canvas)


def _worst(data: Dataset, before: Sequence[Array], noise_rms: Array) -> _Stretch | None:
    """Return where the nominal model misses most in units of the noise, a few swings of the output long."""
    windows = data.judged
    if not windows:
        return None
    size = np.where(noise_rms > 0.0, noise_rms, 1.0)
    missed = [np.mean((before[i][w.start : w.stop] / size) ** 2, axis=0) for i, w in windows]
    at = int(np.argmax([float(np.max(one)) for one in missed]))
    (i, w), o = windows[at], int(np.argmax(missed[at]))
    y = data.records[i].y[w.start : w.stop, o]
    length = min(max(SWINGS * swing_rows(y), LEAST_ROWS), y.size)
    total = np.concatenate([[0.0], np.cumsum(before[i][w.start : w.stop, o] ** 2)])
    begin = w.start + int(np.argmax(total[length:] - total[:-length]))
    return _Stretch(i, w, o, slice(begin, begin + length))


def worst_output(data: Dataset, before: Sequence[Array], noise_rms: Array) -> int:
    """Return the number of the output that the opening shows; the first where there is nothing to show."""
    place = _worst(data, before, noise_rms)
    return 0 if place is None else place.output


def swing_rows(y: Array) -> int:
    """Return the mean length in rows of one swing of `y` (n,) about its mean, half of all rows where it never turns."""
    about = y - y.mean()
    # half the rms on either side: what crosses by noise alone is no swing
    beyond = np.sign(about)[np.abs(about) > 0.5 * float(np.std(y))]
    turns = int(np.count_nonzero(np.diff(beyond)))
    return max(2 * y.size // max(turns, 4), 1)


def surety(diagnosis: Diagnosis) -> Surety:
    """Return how sure the answer of a diagnosis is and everything that keeps it from being surer."""
    why_not = [_rival(diagnosis)]
    if diagnosis.remainder is not None:
        r = diagnosis.remainder
        why_not.append(
            f"{share(r.share)} of the squared error above the noise stays unexplained: {r.lives} "
            f"({chance(r.significance)})."
        )
    if diagnosis.gain is None:
        why_not.append("No segment was held out, so the gain could not be tested on data that no fit has seen.")
    why_not += diagnosis.notes
    return Surety(tuple(_how(diagnosis)), tuple(filter(None, why_not)))


def _how(diagnosis: Diagnosis) -> list[str]:
    said = [f"{c.effect} at {c.where}: {100.0 * c.probability:.1f} % probable." for c in diagnosis.causes]
    if said:
        said.append("That is the share of right answers among answers of equal evidence in blind trials.")
    if diagnosis.verdict == "ambiguous":
        said.append("That the model is wrong is sure; which of the tied causes it is, these data do not tell.")
    least = least_by_chance(diagnosis.evidence)
    if diagnosis.verdict == "unknown" and least is not None:
        p, name, curve = least
        said.append(f"That the model is wrong: by {name}, {curve.where} ({chance(p)}).")
    if diagnosis.verdict == "consistent" and least is not None:
        p, name, curve = least
        if p >= SIGNIFICANT:
            said.append(f"The residual stands out most by {name}, no more than by chance ({chance(p)}).")
        else:
            said.append(
                f"The residual stands out most by {name}: {curve.where} ({chance(p)}). No effect of the library "
                "explains more than noise may."
            )
    return said


def _rival(diagnosis: Diagnosis) -> str:
    """Return the second-best explanation of what was named; nothing where none was weighed."""
    if diagnosis.verdict != "named" or not diagnosis.considered:
        return ""
    name, evidence = diagnosis.considered[0]
    power = math.floor(-evidence / math.log(10.0))
    times = f"10{_superscript(power)}" if power > FAR_LESS else readable(math.exp(max(-evidence, 0.0)))
    return f"The next best explanation, {name or 'nothing added'}, makes the data {times} times less likely."


def _superscript(n: int) -> str:
    return str(n).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
