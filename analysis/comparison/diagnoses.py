"""Two diagnoses side by side: verdict, causes with probability and parameters, gain, and evidence by frequency."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np

from analysis.comparison.api import DIAGNOSIS, document_in
from analysis.comparison.bode import SIZE, STYLES, labels
from analysis.comparison.table import Comparison, Part, Row, Value, beside
from analysis.diagnosis.answer.output import SCHEMA
from analysis.pages.canvas import Canvas
from sim_backend.errors import DataError

FIX = "diagnose again"


class _Estimate(msgspec.Struct):
    value: float | None
    std: float | None
    unit: str


class _Cause(msgspec.Struct):
    effect: str
    where: str
    probability: float
    parameters: dict[str, _Estimate]


class _Gain(msgspec.Struct):
    rms_before: float | None
    rms_after: float | None
    noise_floor: float | None
    reduction: float | None


class _Curve(msgspec.Struct):
    record: str
    output: str
    unit: str
    axis: list[float | None]
    level: list[float | None]


class _Evidence(msgspec.Struct):
    curves: list[_Curve] = []


class _Input(msgspec.Struct):
    file: str


class _Document(msgspec.Struct):
    """What is compared of a diagnosis; the rest of its file is not looked at."""

    verdict: str
    sentence: str
    causes: list[_Cause]
    ambiguous: list[list[str]]
    gain: _Gain | None
    inputs: list[_Input]
    evidence: dict[str, _Evidence]


def compare_diagnoses(first: str, second: str) -> Comparison:
    """Return what two diagnoses say; raises DataError for a file that does not hold one."""
    one, other = _load(first), _load(second)
    parts = (
        Part("Answer", _answers(one, other)),
        Part("Causes", _causes(one, other), "" if one.causes or other.causes else "Neither names a cause."),
        Part("Error on held-out samples, relative to the outputs", _gains(one, other)),
    )
    figures = _figures((first, second), (one, other))
    return Comparison("diagnosis", (first, second), tuple(p for p in parts if p.rows or p.remark), figures)


def _load(path: str) -> _Document:
    file = Path(path) / DIAGNOSIS if Path(path).is_dir() else Path(path)
    found = document_in(file)
    if not isinstance(found, dict) or found.get("schema") != SCHEMA:
        raise DataError(f"{file} is not a diagnosis of the format {SCHEMA}; {FIX}")
    try:
        return msgspec.convert(found, _Document)
    except msgspec.ValidationError as error:
        raise DataError(f"{file}: {error}; {FIX}") from None


def _answers(one: _Document, other: _Document) -> tuple[Row, ...]:
    def tied(document: _Document) -> str:
        return "; ".join(" or ".join(names) for names in document.ambiguous) or "none"

    def logs(document: _Document) -> str:
        return ", ".join(Path(each.file).name for each in document.inputs)

    return (
        Row("verdict", one.verdict, other.verdict),
        Row("causes", _names(one), _names(other)),
        Row("tied", tied(one), tied(other)),
        Row("sentence", one.sentence, other.sentence),
        Row("logs", logs(one), logs(other)),
    )


def _names(document: _Document) -> str:
    return ", ".join(f"{cause.effect} at {cause.where}" for cause in document.causes) or "none"


def _causes(one: _Document, other: _Document) -> tuple[Row, ...]:
    found = [_by_place(document) for document in (one, other)]
    rows: list[Row] = []
    for place in dict.fromkeys(place for each in found for place in each):
        a, b = (each.get(place) for each in found)
        rows.append(beside(f"{place}: probability", (None if c is None else c.probability for c in (a, b))))
        for name in dict.fromkeys(name for cause in (a, b) if cause is not None for name in cause.parameters):
            first, second = (cause.parameters.get(name) if cause is not None else None for cause in (a, b))
            unit = next(p.unit for p in (first, second) if p is not None)
            stds = (first.std if first else None, second.std if second else None)
            values = (first.value if first else None, second.value if second else None)
            rows.append(beside(f"{place}: {name}", values, "" if unit == "1" else unit, stds))
    return tuple(rows)


def _by_place(document: _Document) -> dict[str, _Cause]:
    found: dict[str, _Cause] = {}
    for cause in document.causes:
        place = f"{cause.effect} at {cause.where}"
        while place in found:  # several of one kind at one location
            place += " '"
        found[place] = cause
    return found


def _gains(one: _Document, other: _Document) -> tuple[Row, ...]:
    told = {"rms_before": "before", "rms_after": "extended model", "noise_floor": "noise", "reduction": "reduction"}
    gains = (one.gain, other.gain)

    def percent(gain: _Gain | None, key: str) -> Value:
        value = None if gain is None else getattr(gain, key)
        return None if value is None else 100.0 * value

    if gains == (None, None):
        return ()
    return tuple(beside(text, (percent(gain, key) for gain in gains), "%") for key, text in told.items())


def _figures(names: tuple[str, str], documents: tuple[_Document, _Document]) -> tuple[Canvas, ...]:
    """Return, per output, the nominal residual over the noise by frequency, of the run that it is largest in."""
    found = [_largest(document) for document in documents]
    figures = []
    for output in dict.fromkeys(output for each in found for output in each):
        canvas = Canvas(
            f"Residual by frequency, {output}", "Residual of the nominal model in units of the noise.", size=SIZE
        )
        canvas.panel(0, output, "frequency (Hz)", "residual ÷ noise")
        for name, style, each in zip(labels(names), STYLES, found, strict=True):
            if output in each:
                f, level = each[output]
                canvas.line(0, name, f, level, **style)
        canvas.axes[0].set_xscale("log")
        canvas.axes[0].set_yscale("log")
        canvas.legend_outside(2)
        figures.append(canvas)
    return tuple(figures)


def _largest(document: _Document) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    curves: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for curve in document.evidence.get("frequency", _Evidence()).curves:
        f, level = (np.array(values, dtype=float) for values in (curve.axis, curve.level))
        if f.size and f.size == level.size and np.all(f > 0.0) and np.all(level > 0.0):
            if curve.output not in curves or level.max() > curves[curve.output][1].max():
                curves[curve.output] = f, level
    return curves
