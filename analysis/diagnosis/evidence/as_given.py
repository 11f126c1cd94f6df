"""What the model as given, its own numbers not adjusted, leaves of a record: with every effect that its file states."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from analysis.diagnosis.fitting.fit import steps_of
from analysis.diagnosis.nominal.responses import simulate
from analysis.diagnosis.records.dataset import Dataset, Record
from sim_backend.assembly import places_of, retuned, stated, transducers_of
from sim_backend.effects.base import Site
from sim_backend.effects.sensor_offset import SensorOffset
from sim_backend.linear import Array, played
from sim_backend.model import Model
from sim_backend.replay import replay, stepped


def left_as_given(model: Model, records: Sequence[Record], rate_hz: float) -> list[Array]:
    """Return what a model, played from rest, leaves of each record (n, n_y); not finite where it runs away.

    A zero that was fitted to these very records is as unknown as their starts: see `with_free_zeros`.
    """
    places, transducers = places_of(model), transducers_of(model)
    unknown = {places.outputs[o] for record in records for o in record.free_zeros}
    effects = [e for e in stated(model.effects) if not (isinstance(e, SensorOffset) and e.where in unknown)]
    linear = retuned(model.linear(), effects, places)
    acting = [effect for effect in effects if effect.site is not Site.MODEL]
    if not acting:
        discrete = played(linear, rate_hz)
        return [record.left_by(simulate(discrete, record.u)) for record in records]
    ready = stepped(linear, acting, places, rate_hz, steps_of(linear, rate_hz))
    motions = [
        replay(ready, acting, places, transducers, record.u, rate_hz, temperature_k=record.temperature_k)
        for record in records
    ]
    return [record.left_by(motion.reading) for record, motion in zip(records, motions, strict=True)]


def error_as_given(data: Dataset, model: Model, moving: Collection[str]) -> float | None:
    """Return the error of the model as given on held-out samples: rms over rms about the mean of the `moving` outputs.

    None where no sample is held out, none of them moves, or the model runs away, as one without springs does from rest.
    """
    counted = [o for o, port in enumerate(model.outputs) if port.dof in moving]
    windows = [(i, w) for i, w in data.windows if w.held_out]
    if not windows or not counted:
        return None
    held = sorted({i for i, _ in windows})
    left = dict(zip(held, left_as_given(model, [data.records[i] for i in held], data.rate_hz), strict=True))
    size = np.std(np.concatenate([data.records[i].y[w.start : w.stop, counted] for i, w in windows]), axis=0)
    error = np.concatenate([left[i][w.start : w.stop, counted] for i, w in windows])
    relative = np.sqrt(np.mean((error / np.where(size > 0.0, size, np.nan)) ** 2))
    return float(relative) if np.isfinite(relative) else None
