"""Readings that come in whole steps: found on the recorded numbers themselves, whatever the noise before the rounding.

All differences of such readings are multiples of one step, within the rounding of floating-point numbers, or of the
text that they were written as. Of numbers that do not lie on a lattice each would have to fall within that rounding of
a multiple by chance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.fitting.fit import Setting
from analysis.diagnosis.records.dataset import Dataset
from analysis.diagnosis.variance.chance import Chance
from sim_backend.effects.sensor_quantisation import SensorQuantisation
from sim_backend.linear import Array

_ROUNDING = 4.0
"""A reading is known to so many units of its last place: it was rounded, scaled to SI units, and subtracted."""

_PARTS = (1, 2, 3)
"""The smallest difference seen may be more than one step where few readings lie on many steps."""

_COARSE = 0.1
"""Numbers are no lattice when their last place is more than this part of the step: every float is a multiple then."""

_LOG_CHANCE = math.log(1e-12)
"""Logarithm of the chance above which numbers may lie on a lattice at random."""


@dataclass(frozen=True)
class Lattice:
    """The step of a lattice, its standard deviation, and the natural logarithm of the chance of one at random."""

    step: float
    std: float
    log_p: float


def lattice_of(values: Array) -> Lattice | None:
    """Return the lattice on which all `values` (n,) lie; None when there is none."""
    seen = np.unique(values)
    if seen.size < 4:
        return None
    rounding = _ROUNDING * float(np.finfo(float).eps) * float(np.max(np.abs(seen)))
    seen = np.concatenate([seen[:1], seen[1:][np.diff(seen) > rounding]])
    for part in _PARTS if seen.size > 3 else ():
        found = _with_step(seen, float(np.diff(seen).min()) / part, rounding)
        if found is not None:
            return found
    return None


def _with_step(seen: Array, step: float, rounding: float) -> Lattice | None:
    """Return the lattice with about this `step` on which all of `seen` (k,), ascending, lie."""
    if rounding > _COARSE * step:
        return None
    gaps = np.diff(seen)
    count = float(np.rint(gaps / step).sum())
    # the smallest gap is known to its rounding, the whole span to as much, over many more steps
    exact = float(seen[-1] - seen[0]) / count
    # what text has rounded away nobody has written down: it is how far the numbers are off, if they are off little
    off = max(rounding, float(np.max(np.abs(gaps / exact - np.rint(gaps / exact)))) * exact)
    log_p = (gaps.size - 1) * math.log(2.0 * off / exact)
    return Lattice(exact, off / count, log_p) if off < _COARSE * exact and log_p < _LOG_CHANCE else None


def lattices_of(data: Dataset, outputs: Sequence[str]) -> dict[str, Lattice]:
    """Return the lattice of each of the named `outputs` whose readings lie on one."""
    found = {w: lattice_of(np.concatenate([r.y[:, o] for r in data.records])) for o, w in enumerate(outputs)}
    return {where: lattice for where, lattice in found.items() if lattice is not None}


def rounded_readings(setting: Setting) -> list[Chance]:
    """Return every output whose readings lie on a lattice that the model does not know of."""
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
