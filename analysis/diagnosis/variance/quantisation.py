"""Readings that come in whole steps: seen on the recorded numbers, whatever the noise before the rounding."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from analysis.diagnosis.fitting.fit import Setting
from analysis.diagnosis.records.dataset import Dataset
from analysis.diagnosis.records.lattice import Lattice, lattice_of
from analysis.diagnosis.variance.chance import Chance
from sim_backend.effects.sensor_quantisation import SensorQuantisation


def lattices_of(data: Dataset, outputs: Sequence[str]) -> dict[str, Lattice]:
    """Return the quantisation of each of the named `outputs` whose readings are quantised."""
    found = {w: lattice_of(np.concatenate([r.y[:, o] for r in data.records])) for o, w in enumerate(outputs)}
    return {where: lattice for where, lattice in found.items() if lattice is not None}


def rounded_readings(setting: Setting) -> list[Chance]:
    """Return every output whose readings have a quantisation that the model does not have."""
    known = {e.where for e in setting.known if isinstance(e, SensorQuantisation)}
    rows = setting.rows // setting.data.n_outputs
    found = []
    for where, lattice in lattices_of(setting.data, setting.places.outputs).items():
        if where in known:
            continue
        o = setting.places.outputs.index(where)
        power = float(np.sum(setting.whitener.taps[o] ** 2)) * lattice.step**2 / 12.0
        found.append(
            Chance(
                SensorQuantisation(where, step_size=lattice.step),
                {"step_size": lattice.std},
                -lattice.log_p,
                math.exp(max(lattice.log_p, -700.0)),
                power / setting.data.n_outputs,
                math.sqrt(rows * power),
            )
        )
    return found
