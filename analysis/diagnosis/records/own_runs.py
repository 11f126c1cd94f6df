"""What of a model was fitted to the very runs that are diagnosed: those runs alone decide on it, and may move it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from analysis.diagnosis.records.dataset import Dataset
from sim_backend.effects.sensor_offset import SensorOffset
from sim_backend.model import Model, Quantity, Value


def fitted_to(model: Model, data: Sequence[str]) -> bool:
    """Tell whether a number of the model was fitted to runs or tables of these names, one of which its source has."""
    numbers = [
        value
        for mode in model.modes
        for value in (mode.frequency_hz, mode.decay_rate_1_s, *mode.input.values(), *mode.output.values())
    ]
    return any(_fitted(number, data) for number in numbers)


def with_free_zeros(data: Dataset, model: Model) -> Dataset:
    """Return the data with the zeros free that the model has from a fit to these very runs."""
    runs = [record.name for record in data.records]
    fitted = {
        entry.where
        for entry in model.effects
        for value in entry.parameters.values()
        if entry.effect == SensorOffset.name and _fitted(value, runs)
    }
    free = tuple(o for o, port in enumerate(model.outputs) if port.dof in fitted)
    return replace(data, records=tuple(replace(r, free_zeros=free) for r in data.records)) if free else data


def fitted_delays(model: Model, data: Sequence[str]) -> list[int]:
    """Return the numbers of the inputs whose delay was fitted to runs or tables of these names.

    One that was set before the rest was fitted has no deviation.
    """
    delays = [model.delay_s.get(port.name, 0.0) for port in model.inputs]
    return [j for j, d in enumerate(delays) if isinstance(d, Quantity) and d.value and d.std and _fitted(d, data)]


def _fitted(value: Value, data: Sequence[str]) -> bool:
    """Tell whether a number was fitted to runs or tables of these names, one of which its source has."""
    if not isinstance(value, Quantity) or value.origin != "fitted":
        return False
    return any(name in (value.source or "") for name in data)
