"""Every choice behind the bench and the campaign in one table: value, label, source, and what it moves.

Values and sources are in the model file, what each moves in `choices.toml`. A number of the bench without an entry is
an error, and so is an entry without a number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib import resources
from typing import Any

import msgspec

from analysis.paper.move_length import calibrated_samples
from analysis.paper.numbers import Label
from campaigns.benches import DEFAULT_MODEL
from campaigns.calibration import MOVE_SAMPLES
from campaigns.playing.campaign import load_campaign
from campaigns.strategies.stages import Tuning
from sim_backend.documents import toml_of
from sim_backend.effects import effect_class
from sim_backend.errors import ConfigError
from sim_backend.model import EffectEntry, Model, Origin, Quantity, Value, load_model

WORDS = "analysis/paper/choices.toml"

LABEL_OF: dict[Origin, Label | str] = {
    "printed": "input",
    "derived": "input",
    "calibrated": "calibrated",
    "fitted": "calibrated",
    "assumed": "assumed",
    "stated": "assumed",
}
"""What an origin of the model file is called here. Nothing that is chosen is *predicted*."""

UNITS = {"a": ("A", "m"), "s": ("1", "m"), "theta": ("N m", "rad"), "z": ("N", "m")}
"""Input and output unit of an effect's parameters by the beginning of its location."""


class _Words(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    moves: str
    bound: str = ""
    label: str = ""
    source: str = ""


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    mode: dict[str, _Words]
    hardware: dict[str, _Words]
    effect: dict[str, _Words]
    played: dict[str, _Words]


@dataclass(frozen=True)
class Choice:
    """One number: what it is and where, its value in SI, its unit where the name has none, and what is said of it.

    `label` is *input*, *calibrated*, *bound* (assumed, and held by a printed bound) or *assumed*.
    """

    what: str
    places: tuple[str, ...]
    value: float
    unit: str
    label: str
    source: str
    moves: str


@dataclass(frozen=True)
class _Found:
    """A number of the bench: its group of `choices.toml`, its keys there, the first that has an entry counting."""

    group: str
    keys: tuple[str, ...]
    what: str
    place: str
    unit: str
    quantity: Quantity


def choices(model: Model | None = None) -> list[Choice]:
    """Return every choice, those of the bench as built (or another `model`) before those of the campaign.

    Raises ConfigError for a number without an entry in `choices.toml` and for an entry that no number of the bench as
    built has.
    """
    words = msgspec.convert(_content(), _File)
    bench = load_model(DEFAULT_MODEL) if model is None else model
    used: set[tuple[str, str]] = set()
    rows: dict[tuple[object, ...], Choice] = {}
    for found in _numbers(bench):
        table: dict[str, _Words] = getattr(words, found.group)
        key = next((k for k in found.keys if k in table), None)
        if key is None:
            raise ConfigError(
                f"{WORDS}: nothing is said of '{found.keys[0]}'; say what it moves under [{found.group}.\"…\"]"
            )
        used.add((found.group, key))
        choice = _choice(found, table[key])
        same = choice.what, choice.value, choice.label, choice.source
        rows[same] = choice if same not in rows else _beside(rows[same], choice.places)
    if model is None:
        _require_used(words, used)
    return [*rows.values(), *_played(words)]


def choices_table(rows: list[Choice]) -> str:
    """Return the choices as a table in Markdown."""
    heads = ("number", "where", "value", "label", "source", "moves")
    cells = [
        (f"`{r.what}`", ", ".join(r.places), f"{r.value:.6g} {r.unit}".strip(), r.label, r.source, r.moves)
        for r in rows
    ]
    lines = [heads, tuple("---" for _ in heads), *cells]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def _content() -> dict[str, Any]:
    resource = resources.files("analysis.paper") / "choices.toml"
    return toml_of(resource.read_text(encoding="utf-8"), WORDS)


def _choice(found: _Found, words: _Words) -> Choice:
    label = words.label or ("bound" if words.bound else str(LABEL_OF[found.quantity.origin]))
    source = found.quantity.source + (f" (bound: {words.bound})" if words.bound else "")
    return Choice(found.what, (found.place,), found.quantity.value, found.unit, label, source, words.moves)


def _beside(choice: Choice, places: tuple[str, ...]) -> Choice:
    return replace(choice, places=(*choice.places, *places))


def _numbers(model: Model) -> Iterator[_Found]:
    """Yield every number of a bench, in the order of its file."""
    for mode in model.modes:
        axis = mode.label.split()[0]
        for name in ("frequency_hz", "decay_rate_1_s"):
            keys = f"{mode.label}: {name}", mode.label
            yield _Found("mode", keys, f"{mode.label}: {name}", axis, "", _quantity(getattr(mode, name)))
        for name in ("input", "input_direct", "output", "output_rate"):
            for port, value in getattr(mode, name).items():
                what = f"{mode.label}: {name}"
                yield _Found("mode", (what, mode.label), what, port, "", _quantity(value))
    for name, value in _hardware(model):
        yield _Found("hardware", (name,), name, "hardware", "", _quantity(value))
    for entry in model.effects:
        kind = f"{entry.effect} ({entry.note})" if entry.effect == "delay" and entry.note else entry.effect
        for name, value in entry.parameters.items():
            keys = f"{entry.effect}: {name}", entry.effect
            yield _Found("effect", keys, f"{kind}: {name}", entry.where, _unit(entry, name), _quantity(value))


def _hardware(model: Model) -> Iterator[tuple[str, Value]]:
    if model.hardware is None:
        return
    yield "actuators.radius_m", model.hardware.actuators.radius_m
    yield "sensors.radius_m", model.hardware.sensors.radius_m
    for field in msgspec.structs.fields(model.hardware):
        value = getattr(model.hardware, field.name)
        if isinstance(value, float | int | Quantity):
            yield field.name, value


def _unit(entry: EffectEntry, name: str) -> str:
    dimension = next(p.dimension for p in effect_class(entry.effect).parameters() if p.name == name)
    units = next(units for start, units in UNITS.items() if entry.where.startswith(start))
    found = dimension.unit(*units)
    return "" if found == "1" else found


def _quantity(value: Value) -> Quantity:
    return value if isinstance(value, Quantity) else Quantity(value=float(value))


def _require_used(words: _File, used: set[tuple[str, str]]) -> None:
    for group in ("mode", "hardware", "effect"):
        for key in getattr(words, group):
            if (group, key) not in used:
                raise ConfigError(f'{WORDS}: [{group}."{key}"] names nothing on the bench; remove it')


def _learning_s(axis_deg: float) -> float:
    """Return for how long the paper's campaign lets the repetitive controller of an axis learn."""
    for run in load_campaign("paper").runs:
        settings = run.settings
        if settings.get("strategy") == "repetitive" and settings.get("alpha_deg") == axis_deg:
            return float(settings["tuning"]["learning_s"])
    raise ConfigError(f"the paper's campaign has no repetitive chop at {axis_deg:g} degrees")


PLAYED: dict[str, Callable[[], float]] = {
    "sample rate (Hz)": lambda: load_model(DEFAULT_MODEL).sample_rate_hz,
    "feed-forward of the bench (samples)": lambda: float(MOVE_SAMPLES),
    "feed-forward of Table 6.4 (samples)": lambda: float(calibrated_samples()),
    "move of the learned reference (s)": lambda: Tuning().move_s,
    "disturbance of the chops of Table 6.7 (lowest level)": lambda: min(load_campaign("paper").levels().values()),
    "learning of θx (s)": lambda: _learning_s(0.0),
    "learning of θy (s)": lambda: _learning_s(90.0),
}
"""Choices about what is played, each from the code that plays it."""


def _played(words: _File) -> list[Choice]:
    if list(words.played) != list(PLAYED):
        raise ConfigError(f"{WORDS}: [played] names {list(words.played)}, and there are {list(PLAYED)}")
    return [
        Choice(name, ("campaign",), PLAYED[name](), "", told.label, told.source, told.moves)
        for name, told in words.played.items()
    ]
