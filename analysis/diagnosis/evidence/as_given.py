"""What the model as given, its own numbers not adjusted, leaves of a record."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from analysis.diagnosis.nominal.responses import played, simulate
from analysis.diagnosis.records.dataset import Dataset, Record
from sim_backend.linear import Array, ModalModel


def left_as_given(linear: ModalModel, record: Record, rate_hz: float) -> Array:
    """Return what the linear part of a model, played from rest, leaves of a record (n, n_y)."""
    return record.left_by(simulate(played(linear, rate_hz), record.u))


def error_as_given(data: Dataset, linear: ModalModel, outputs: Sequence[str], moving: Collection[str]) -> float | None:
    """Return the error of the model as given on held-out samples: rms over rms about the mean of the `moving` outputs.

    None where no sample is held out, none of them moves, or the model runs away, as one without springs does from rest.
    """
    counted = [o for o, name in enumerate(outputs) if name in moving]
    windows = [(i, w) for i, w in data.windows if w.held_out]
    if not windows or not counted:
        return None
    left = {i: left_as_given(linear, data.records[i], data.rate_hz) for i in {i for i, _ in windows}}
    size = np.std(np.concatenate([data.records[i].y[w.start : w.stop, counted] for i, w in windows]), axis=0)
    error = np.concatenate([left[i][w.start : w.stop, counted] for i, w in windows])
    relative = np.sqrt(np.mean((error / np.where(size > 0.0, size, np.nan)) ** 2))
    return float(relative) if np.isfinite(relative) else None
