"""Two models side by side: modes, static gains, delays, effects, and the Bode diagram of both."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy.optimize

from analysis.comparison.bode import Curve, bode_figures
from analysis.comparison.table import Comparison, Part, Row, Value, beside
from analysis.diagnosis.answer.changes import unit_of
from sim_backend.errors import ConfigError
from sim_backend.linear import Array
from sim_backend.model import Mode, Model, load_model, number, with_std

POINTS = 600

_NOTHING: tuple[float | None, float | None] = (None, None)
"""Value and standard deviation of what one of both models lacks."""


def compare_models(first: str, second: str) -> Comparison:
    """Return modes by their nearest frequencies, gains and delays by port, effects by location, and the responses.

    `first` and `second` name a bundled model or a file. Raises ConfigError for what is neither.
    """
    one, other = load_model(first), load_model(second)
    parts = (
        Part("Ports", _ports(one, other)),
        Part("Modes", _modes(one, other), "Modes stand beside those of the nearest frequency and shape."),
        Part("Static gains", _gains(one, other)),
        Part("Delays", _delays(one, other)),
        Part("Effects", _effects(one, other)),
    )
    figures = bode_figures((first, second), (_curves(one, other), _curves(other, one)))
    return Comparison("model", (first, second), tuple(part for part in parts if part.rows), figures)


def _ports(one: Model, other: Model) -> tuple[Row, ...]:
    def told(model: Model, role: str) -> str:
        return ", ".join(f"{port.name} ({port.unit})" for port in getattr(model, role))

    rows = [Row(role, told(one, role), told(other, role)) for role in ("inputs", "outputs")]
    return (*rows, Row("sample rate", one.sample_rate_hz, other.sample_rate_hz, "Hz"))


def _modes(one: Model, other: Model) -> tuple[Row, ...]:
    rows: list[Row] = []
    for k, (a, b) in enumerate(_matched(one, other), start=1):
        frequency = [_NOTHING if mode is None else with_std(mode.frequency_hz) for mode in (a, b)]
        damping = [_NOTHING if mode is None else mode.damping_ratio() for mode in (a, b)]
        name = _name(k, next(mode for mode in (a, b) if mode is not None))
        rows.append(beside(f"{name}, frequency", (f[0] for f in frequency), "Hz", (f[1] for f in frequency)))
        rows.append(beside(f"{name}, damping ratio ζ", (z[0] for z in damping), "", (z[1] for z in damping)))
    return tuple(rows)


def _name(k: int, mode: Mode) -> str:
    return f"mode {k}" if not mode.label or mode.label.startswith("mode ") else f"mode {k} ({mode.label})"


def _place(mode: Mode) -> float:
    return math.log(max(number(mode.frequency_hz), 1e-6))


def _shape(mode: Mode) -> dict[tuple[str, str], float]:
    """Return what the mode adds to every entry of the response, but for its frequency."""
    return {(o, i): number(c) * number(b) for o, c in mode.output.items() for i, b in mode.input.items()}


def _likeness(first: Mode, second: Mode) -> float:
    """Return the modal assurance criterion of the shapes of two modes, between 0 and 1."""
    a, b = _shape(first), _shape(second)
    norms = [sum(x * x for x in shape.values()) for shape in (a, b)]
    inner = sum(value * b.get(place, 0.0) for place, value in a.items())
    return inner * inner / (norms[0] * norms[1]) if all(norms) else 0.0


def _matched(one: Model, other: Model) -> list[tuple[Mode | None, Mode | None]]:
    """Return pairs of modes nearest in the logarithm of frequency and in shape, and the others alone, by frequency."""
    first, second = one.modes, other.modes
    if first and second:
        apart = [[abs(_place(a) - _place(b)) + 1.0 - _likeness(a, b) for b in second] for a in first]
        rows, columns = (index.tolist() for index in scipy.optimize.linear_sum_assignment(apart))
    else:
        rows, columns = [], []
    pairs: list[tuple[Mode | None, Mode | None]] = [(first[i], second[j]) for i, j in zip(rows, columns, strict=True)]
    pairs += [(mode, None) for i, mode in enumerate(first) if i not in rows]
    pairs += [(None, mode) for j, mode in enumerate(second) if j not in columns]
    return sorted(pairs, key=lambda pair: _place(next(mode for mode in pair if mode is not None)))


def _gains(one: Model, other: Model) -> tuple[Row, ...]:
    found = [_static(model) for model in (one, other)]
    return tuple(
        beside(f"{i} → {o}", (gains.get((o, i)) for gains in found), units)
        for (o, i), units in {**_entries(one), **_entries(other)}.items()
        if any(gains.get((o, i)) for gains in found)
    )


def _entries(model: Model) -> dict[tuple[str, str], str]:
    return {(o.name, i.name): f"{o.unit} per {i.unit}" for o in model.outputs for i in model.inputs}


def _static(model: Model) -> dict[tuple[str, str], float]:
    """Return the static gain of every entry; none where a rigid body has no such gain."""
    linear = model.linear()
    if not np.all(linear.omega_rad_s > 0.0):
        return {}
    gains = linear.with_(delay_s=0.0 * linear.delay_s).frequency_response(np.zeros(1))[0].real
    return {
        (o.name, i.name): float(gains[k, j]) for k, o in enumerate(model.outputs) for j, i in enumerate(model.inputs)
    }


def _delays(one: Model, other: Model) -> tuple[Row, ...]:
    rows = []
    for name in dict.fromkeys(port.name for model in (one, other) for port in model.inputs):
        told = [
            with_std(model.delay_s.get(name, 0.0)) if name in {p.name for p in model.inputs} else _NOTHING
            for model in (one, other)
        ]
        if any(value for value, _ in told):
            rows.append(beside(name, (value for value, _ in told), "s", (std for _, std in told)))
    return tuple(rows)


def _effects(one: Model, other: Model) -> tuple[Row, ...]:
    found = [_parameters(model) for model in (one, other)]
    rows = []
    for name in dict.fromkeys(name for each in found for name in each):
        both = [each.get(name, (None, None, "")) for each in found]
        unit = next(filter(None, (unit for *_, unit in both)), "")
        rows.append(beside(name, (value for value, *_ in both), unit, (std for _, std, _ in both)))
    return tuple(rows)


def _parameters(model: Model) -> dict[str, tuple[Value, float | None, str]]:
    """Return every parameter of every effect with deviation and unit; an effect without any says that it is there."""
    told: dict[str, tuple[Value, float | None, str]] = {}
    for entry in model.effects:
        place = f"{entry.effect} at {entry.where}"
        while any(name.startswith(place) for name in told):  # several of one kind at one location
            place += " '"
        for name, value in entry.parameters.items():
            told[f"{place}: {name}"] = *with_std(value), unit_of(entry, name, model)
        if not entry.parameters:
            told[place] = "yes", None, ""
    return told


def _curves(model: Model, other: Model) -> list[Curve]:
    f = _frequencies((model, other))
    f = f[f <= 0.5 * model.sample_rate_hz]
    response = model.linear().frequency_response(f)
    return [
        Curve(o.name, i.name, f"{o.unit} per {i.unit}", f, response[:, k, j])
        for k, o in enumerate(model.outputs)
        for j, i in enumerate(model.inputs)
    ]


def _frequencies(models: Sequence[Model]) -> Array:
    own = [hz for model in models for mode in model.modes if (hz := number(mode.frequency_hz)) > 0.0]
    top = 0.5 * max(model.sample_rate_hz for model in models)
    if top <= 0.0:
        raise ConfigError(f"the sample rate is {2.0 * top} Hz; it must be above zero")
    low = min(0.1 * min(own, default=0.01 * top), 0.1 * top)
    # every mode as well: a narrow one lies between the points of an even grid
    return np.unique(np.concatenate([np.geomspace(low, top, POINTS), [hz for hz in own if low <= hz <= top]]))
