"""Model ↔ TOML: ports, modes, effects and hardware of one bench, each number with where it comes from.

A number in a model file is either plain (`0.04`, whose origin is then *stated*) or a table that says more:

    frequency_hz = { value = 29.56, origin = "printed", source = "Table 6.2, factored" }

Origins: *printed* (copied from the paper), *calibrated* (set so that a named number is matched), *assumed* (with the
reason), *derived* (computed from others), *fitted* (estimated from named data, with `std`), *stated* (by whoever
wrote the file).
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
import tomli_w

from sim_backend.documents import json_of, read_text, toml_of
from sim_backend.errors import ConfigError, did_you_mean
from sim_backend.linear import ModalModel
from sim_backend.plausible import refuse_absurd, refuse_contradiction

Origin = Literal["printed", "calibrated", "assumed", "derived", "fitted", "stated"]


Intersample = Literal["held", "band-limited"]


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, kw_only=True):
    """Base of all tables: unknown fields are errors, defaults are not written."""


class Quantity(_Strict, frozen=True, kw_only=True):
    """A number with its origin, the source of it, and its standard deviation where it was estimated."""

    value: float
    origin: Origin = "stated"
    source: str = ""
    std: float | None = None


Value = float | Quantity


def number(value: Value) -> float:
    """Return the plain number of a value."""
    return value.value if isinstance(value, Quantity) else float(value)


def with_std(value: Value) -> tuple[float, float | None]:
    """Return the plain number of a value and its standard deviation, None where that is not known."""
    return number(value), value.std if isinstance(value, Quantity) else None


class Port(_Strict, frozen=True, kw_only=True):
    """One input or output: channel name, unit, and the degree of freedom that pairs inputs with outputs."""

    name: str
    unit: str
    dof: str


class Mode(_Strict, frozen=True, kw_only=True):
    """One second-order block (see `sim_backend.linear`); participations are keyed by port name, missing means zero."""

    label: str
    frequency_hz: Value
    decay_rate_1_s: Value
    input: dict[str, Value]
    output: dict[str, Value]
    input_direct: dict[str, Value] = {}
    output_rate: dict[str, Value] = {}

    def damping_ratio(self) -> tuple[float | None, float | None]:
        """Return ζ and its standard deviation; None where either is not known, both of a rigid body."""
        (hz, hz_std), (decay, decay_std) = with_std(self.frequency_hz), with_std(self.decay_rate_1_s)
        if not hz:
            return None, None
        zeta = decay / (2.0 * math.pi * hz)
        if hz_std is None or decay_std is None:
            return zeta, None
        return zeta, math.hypot(decay_std / (2.0 * math.pi * hz), zeta * hz_std / hz)


class EffectEntry(_Strict, frozen=True, kw_only=True):
    """One effect of `sim_backend.effects` at a location, with its parameters."""

    effect: str
    where: str
    parameters: dict[str, Value] = {}
    note: str = ""


class Ring(_Strict, frozen=True, kw_only=True):
    """Three transducers on a circle, 120 degrees apart as in `sim_backend.kinematics`."""

    names: list[str]
    radius_m: Value


class Hardware(_Strict, frozen=True, kw_only=True):
    """Actuators, sensors, limits and thermal behaviour of a three-axis bench (θx, θy, z).

    `theodolite_noise_rad` is the standard deviation of one theodolite reading; without it there is no theodolite.
    """

    actuators: Ring
    sensors: Ring
    force_constant_n_a: Value
    actuator_steepness_n_sqrt_w: Value
    peak_current_a: Value
    continuous_force_n: Value
    end_stop_angle_rad: Value
    end_stop_z_m: Value
    cold_finger_k: Value
    thermal_resistance_k_w: Value
    thermal_time_constant_s: Value
    theodolite_noise_rad: Value | None = None


class Model(_Strict, frozen=True, kw_only=True):
    """A whole model file; `linear()` gives its modes as arrays.

    `intersample` says how a recorded input went on between its samples: *held*, as the bench's own converter does, or
    *band-limited*, as a recorder behind a filter sees it. `coordinates` states, per input's degree of freedom, the
    motion it works against as weights of the outputs (see `sim_backend.assembly.coordinates_of`).
    """

    schema: Literal["mccd-model/1"] = "mccd-model/1"
    name: str
    title: str = ""
    sample_rate_hz: float
    inputs: list[Port]
    outputs: list[Port]
    modes: list[Mode]
    feedthrough: dict[str, dict[str, Value]] = {}
    delay_s: dict[str, Value] = {}
    intersample: Intersample = "held"
    coordinates: dict[str, dict[str, Value]] = {}
    effects: list[EffectEntry] = []
    hardware: Hardware | None = None

    def linear(self) -> ModalModel:
        """Return the modes as a ModalModel, inputs and outputs in the order of the file."""
        ins, outs = [p.name for p in self.inputs], [p.name for p in self.outputs]
        b, b_direct = (
            _rows([m.input for m in self.modes], ins),
            _rows([m.input_direct for m in self.modes], ins),
        )
        c, c_rate = (
            _rows([m.output for m in self.modes], outs).T,
            _rows([m.output_rate for m in self.modes], outs).T,
        )
        return ModalModel(
            omega_rad_s=np.array([2.0 * np.pi * number(m.frequency_hz) for m in self.modes]),
            sigma_1_s=np.array([number(m.decay_rate_1_s) for m in self.modes]),
            b=b,
            b_direct=b_direct,
            c=c,
            c_rate=c_rate,
            d=_rows([self.feedthrough.get(o, {}) for o in outs], ins),
            delay_s=np.array([number(self.delay_s.get(i, 0.0)) for i in ins]),
        )


def _rows(tables: list[dict[str, Value]], names: list[str]) -> np.ndarray:
    out, columns = np.zeros((len(tables), len(names))), {name: i for i, name in enumerate(names)}
    for row, table in zip(out, tables, strict=True):
        for name, value in table.items():  # most name one port of many
            if name in columns:
                row[columns[name]] = number(value)
    return out


def from_linear(
    linear: ModalModel,
    *,
    name: str,
    title: str,
    sample_rate_hz: float,
    inputs: list[Port],
    outputs: list[Port],
    origin: Origin,
    source: str,
    std: ModalModel | None = None,
) -> Model:
    """Return a model file's content for a linear model, every number with `origin`, `source` and, if given, its `std`.

    `std` holds standard deviations in the same shapes as `linear` (a ModalModel used as a container).
    """

    def value(x: float, s: float | None) -> Value:
        return Quantity(value=float(x), origin=origin, source=source, std=None if s is None else float(s))

    def table(row: np.ndarray, std_row: np.ndarray | None, names: list[str]) -> dict[str, Value]:
        return {n: value(row[i], None if std_row is None else std_row[i]) for i, n in enumerate(names) if row[i] != 0.0}

    ins, outs = [p.name for p in inputs], [p.name for p in outputs]
    modes = []
    for m in range(linear.n_blocks):
        f_hz = linear.omega_rad_s[m] / (2.0 * np.pi)
        modes.append(
            Mode(
                label=f"mode {m + 1}",
                frequency_hz=value(f_hz, None if std is None else std.omega_rad_s[m] / (2.0 * np.pi)),
                decay_rate_1_s=value(linear.sigma_1_s[m], None if std is None else std.sigma_1_s[m]),
                input=table(linear.b[m], None if std is None else std.b[m], ins),
                output=table(linear.c[:, m], None if std is None else std.c[:, m], outs),
                input_direct=table(linear.b_direct[m], None if std is None else std.b_direct[m], ins),
                output_rate=table(linear.c_rate[:, m], None if std is None else std.c_rate[:, m], outs),
            )
        )
    feedthrough = {
        o: table(linear.d[i], None if std is None else std.d[i], ins) for i, o in enumerate(outs) if np.any(linear.d[i])
    }
    delay = table(linear.delay_s, None if std is None else std.delay_s, ins)
    return Model(
        name=name,
        title=title,
        sample_rate_hz=sample_rate_hz,
        inputs=inputs,
        outputs=outputs,
        modes=modes,
        feedthrough=feedthrough,
        delay_s=delay,
    )


@lru_cache(maxsize=8)
def parse_model(text: str, where: str) -> Model:
    """Return the model written in `text`, TOML or JSON; `where` names it in errors.

    The same text gives the same object, so nothing may change it. Raises ConfigError for broken TOML or JSON, unknown
    fields, wrong types, unknown port names and numbers that are not finite.
    """
    try:
        # no TOML file begins with a brace, and every model in JSON does
        content = json_of(text, where, error=ConfigError) if text.lstrip().startswith("{") else toml_of(text, where)
        model = msgspec.convert(content, Model)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{where}: {error}; see docs/model-file.md for the fields") from None
    check_model(model, where)
    return model


def check_model(model: Model, where: str) -> None:
    """Raise ConfigError for port names, frequencies or numbers that cannot be; `where` names the file in it."""
    if not 0.0 < model.sample_rate_hz < 1e9:
        raise ConfigError(f"{where}: sample_rate_hz is {model.sample_rate_hz:g}; it must lie between 0 and 1e9")
    if not model.inputs or not model.outputs:
        raise ConfigError(f"{where}: a model needs at least one input and one output; add [[inputs]] and [[outputs]]")
    ins, outs = {p.name for p in model.inputs}, {p.name for p in model.outputs}
    if len(ins) < len(model.inputs) or len(outs) < len(model.outputs):
        raise ConfigError(f"{where}: two ports have the same name; every input and every output needs its own")
    for mode in model.modes:
        for field, table, known in (
            ("input", mode.input, ins),
            ("input_direct", mode.input_direct, ins),
            ("output", mode.output, outs),
            ("output_rate", mode.output_rate, outs),
        ):
            unknown = sorted(set(table) - known)
            if unknown:
                raise ConfigError(
                    f"{where}: mode '{mode.label}' names {field} '{unknown[0]}', which is not a port; "
                    f"ports: {', '.join(sorted(known))}"
                )
        if number(mode.frequency_hz) < 0.0:
            raise ConfigError(
                f"{where}: mode '{mode.label}' has frequency_hz {number(mode.frequency_hz):g}; it must be zero (rigid "
                f"body) or more"
            )
    _check_coordinates(model, where)
    content = msgspec.to_builtins(model)
    refuse_absurd(content, where)
    if model.hardware is not None:
        refuse_contradiction(content["hardware"], where)
    model.linear()


def _check_coordinates(model: Model, where: str) -> None:
    dofs, outs = {p.dof for p in model.inputs}, {p.name for p in model.outputs}
    for dof, weights in model.coordinates.items():
        unknown = sorted({dof} - dofs) or sorted(set(weights) - outs)
        if unknown:
            raise ConfigError(
                f"{where}: coordinates name '{unknown[0]}'; they are given per degree of freedom of an input "
                f"({', '.join(sorted(dofs))}) as weights of outputs ({', '.join(sorted(outs))})"
            )


_BUNDLED = Path(__file__).parent / "models"


def bundled_models() -> list[str]:
    """Return the names of the models that come with the package."""
    return sorted(file.stem for file in _BUNDLED.glob("*.toml"))


def load_model(name_or_path: str | Path) -> Model:
    """Return a bundled model by name, or the model in a TOML file.

    Raises ConfigError when there is neither, or when the file is larger than 10 MB or not a valid model.
    """
    path = Path(name_or_path)
    if str(name_or_path) in bundled_models():
        return parse_model((_BUNDLED / f"{name_or_path}.toml").read_text(encoding="utf-8"), f"model {name_or_path}")
    near = did_you_mean(str(name_or_path), bundled_models())
    fix = f"nor is it a bundled model; {near}bundled: {', '.join(bundled_models())}"
    return parse_model(read_text(path, "model", fix=fix), str(path))


def dump_model(model: Model, form: Literal["toml", "json"] = "toml") -> str:
    """Return the text of a model in TOML or JSON; `parse_model` gives the same model back."""
    content = msgspec.to_builtins(model)
    return (
        tomli_w.dumps(content) if form == "toml" else msgspec.json.format(msgspec.json.encode(content)).decode() + "\n"
    )
