"""`analysis.diagnose`: a diagnosis of arrays, for scripts and notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from analysis.diagnosis.pipeline import Options
from analysis.diagnosis.pipeline import diagnose as _diagnose
from analysis.diagnosis.records.checks import check_enough, check_inputs, check_outputs, without_copies, without_cut_off
from analysis.diagnosis.records.dataset import Dataset, Record, Window, period_within
from analysis.diagnosis.records.holding import with_held_out
from analysis.diagnosis.result import Diagnosis
from campaigns.facts.clipping import cut_off_in
from sim_backend.errors import ConfigError
from sim_backend.linear import Array
from sim_backend.model import Model


def diagnose(
    inputs: ArrayLike | Sequence[ArrayLike],
    outputs: ArrayLike | Sequence[ArrayLike],
    rate_hz: float,
    model: Model,
    *,
    held_out: Sequence[int] = (),
    period: int = 0,
    temperature_k: Sequence[ArrayLike] | None = None,
    options: Options | None = None,
) -> Diagnosis:
    """Return what `model` gets wrong about records, why, and what correcting it gains.

    Shapes: each record's input (n, n_u) and output (n, n_y), or (n,) for one channel, in the order and units of the
    model's ports; one record or a list of them, each starting in an unknown state. `held_out` numbers the records that
    no fit may see, from 0; by default the last whose inputs differ in amplitude or waveform from all before them, else
    the last fifth of each record. `period` is that of the excitation in samples, 0 when it does not repeat.
    `temperature_k` has one (n,) per record. Write the result with `analysis.diagnosis.answer.output.write_files` and
    `analysis.diagnosis.answer.page.write_page`. Raises ConfigError when arrays and model do not match, DataError for
    records that decide nothing: too few samples, a constant or cut-off output, inputs at rest.
    """
    us, ys = _records(inputs, len(model.inputs), "inputs"), _records(outputs, len(model.outputs), "outputs")
    if len(us) != len(ys):
        raise ConfigError(f"{len(us)} input and {len(ys)} output records; give one of each per record")
    if not rate_hz > 0.0:
        raise ConfigError(f"rate_hz is {rate_hz}; it must be above zero")
    outside = [i for i in held_out if not 0 <= i < len(us)]
    if outside:
        raise ConfigError(f"held_out names record {outside[0]}; there are records 0 to {len(us) - 1}")
    warm: list[Array | None] = [None] * len(us)
    if temperature_k is not None:
        warm = [np.ascontiguousarray(t, dtype=float) for t in temperature_k]
    records = [
        Record(
            f"record {i}",
            u,
            y,
            (Window(f"record {i}", 0, u.shape[0], i in held_out, period_within(period, u.shape[0])),),
            t,
        )
        for i, (u, y, t) in enumerate(zip(us, ys, warm, strict=True))
    ]
    check_outputs(records, [p.name for p in model.outputs], "outputs")
    facts = [
        fact
        for record in records
        for o, port in enumerate(model.outputs)
        for fact in cut_off_in(record.y[:, o], port.name, port.unit, record.name)
    ]
    records, cut = without_cut_off(records, [p.name for p in model.outputs], facts)
    notes = cut + check_inputs(records, [p.name for p in model.inputs])
    different, copies = without_copies(records, [p.name for p in model.outputs])
    held, note = with_held_out(different)
    check_enough(held, "the records")
    found = _diagnose(Dataset(float(rate_hz), held).seen_by(model), model, options or Options())
    return replace(found, notes=(*notes, *copies, *([note] if note else []), *found.notes))


def _records(values: ArrayLike | Sequence[ArrayLike], channels: int, what: str) -> list[Array]:
    """Return a list of (n, channels): a list of arrays is one record each, anything else one record."""
    several = isinstance(values, list | tuple) and len(values) > 0 and np.ndim(values[0]) > 0
    out = []
    for i, one in enumerate(values if several else [values]):  # type: ignore[arg-type]
        array = np.asarray(one, dtype=float)
        array = array[:, None] if array.ndim == 1 else array
        if array.ndim != 2 or array.shape[1] != channels:
            raise ConfigError(
                f"record {i} of the {what} has shape {array.shape}; the model needs (n, {channels}), a column per port"
            )
        out.append(np.ascontiguousarray(array))
    return out
