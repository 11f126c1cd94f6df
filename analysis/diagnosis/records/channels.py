"""Which channel of a log is which port of the model, and whether what it recorded can be used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from campaigns.log import Run, unit_named
from sim_backend.errors import ConfigError, DataError
from sim_backend.model import Model, Port

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Match:
    """Names of a run's channels in the order of the model's ports; `temperature` is None when it was not recorded."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    temperature: str | None
    notes: tuple[str, ...]


def match_channels(run: Run, model: Model) -> Match:
    """Return which channels of `run` are the model's ports: by the port's name, else by its degree of freedom.

    Raises ConfigError naming the port and the channels there are when a port has no channel, several, or one in
    another unit.
    """
    inputs = tuple(_channel_of(run, port, "input") for port in model.inputs)
    outputs = tuple(_channel_of(run, port, "output") for port in model.outputs)
    kelvin = [n for n in run.names("aux") if run.channels[n].unit == "K"]
    named = [n for n in kelvin if n.startswith("temperature")] or kelvin
    notes = []
    for role, used in (("input", inputs), ("output", outputs)):
        left = [n for n in run.names(role) if n not in used]
        if left:
            consequence = "what it moves counts as an error of the model" if role == "input" else "it is not judged"
            notes.append(f"{run.path.name}: the model has no {role} for {', '.join(left)}; {consequence}")
    if len(named) > 1:
        notes.append(f"{run.path.name}: of {', '.join(named)} the temperature used is {named[0]}")
    return Match(inputs, outputs, named[0] if named else None, tuple(notes))


def _channel_of(run: Run, port: Port, role: str) -> str:
    names = run.names(role)
    found = [n for n in names if n == port.name] or [n for n in names if run.channels[n].dof == port.dof]
    have = ", ".join(f"{n} ({run.channels[n].dof or 'no dof'})" for n in names) or "none"
    if len(found) != 1:
        many = f"{len(found)} {role} channels" if found else f"no {role} channel"
        raise ConfigError(
            f"{run.path}: {many} for the model's {role} '{port.name}' (dof {port.dof}); it has {have}: give a model of "
            "these channels, or name them in the import map as the model does"
        )
    unit, wanted = run.channels[found[0]].unit, unit_named(port.unit)
    if wanted.si != unit or wanted.symbol != wanted.si:
        raise ConfigError(
            f"{run.path}: channel '{found[0]}' is in {unit}, the model's {role} '{port.name}' in {port.unit}; "
            "logs are in SI: write the model in the same unit"
        )
    return found[0]


def check_finite(values: Array, names: Sequence[str], file: str, first_row: int) -> None:
    """Raise DataError naming file, channel and row when `values` (n, k) hold a number that is not finite."""
    bad = np.argwhere(~np.isfinite(values))
    if bad.size:
        row, column = int(bad[0][0]), int(bad[0][1])
        raise DataError(
            f"{file}: channel '{names[column]}' holds {values[row, column]} in row {first_row + row}, and "
            f"{len(bad)} value(s) in all are not finite; repair them or import the stretches between them"
        )
