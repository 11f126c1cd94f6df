"""How large each effect of the library would have to be for these data to show it: what a diagnosis could not see."""

from __future__ import annotations

import numpy as np

from analysis.diagnosis.result import Visible
from analysis.diagnosis.search.rounds import Found
from sim_backend.effects.base import Aux
from sim_backend.model import Model
from sim_backend.modes import units_at


def sensitivity_of(found: Found, model: Model) -> tuple[Visible, ...]:
    """Return the visible size of every effect at every location beside the best fit, by effect and location.

    It is given by the first parameter that measures the effect, in the shape that shows best. Empty where the error is
    not weighed by noise; effects that show only in the variance of the residual have no such size and are not listed,
    nor are those of a temperature that does not change.
    """
    if found.setting.whitener.even:
        return ()
    best: dict[tuple[str, str], Visible] = {}
    warms = found.setting.data.warms
    for candidate, sizes in zip(found.last.candidates, found.last.seen, strict=True):
        if not candidate.unit_sizes:
            continue  # it is there as a whole or not at all
        if candidate.effect.aux is Aux.TEMPERATURE and not warms:
            continue
        name, unit_size = next(iter(candidate.unit_sizes.items()))
        size, key = float(abs(unit_size) * sizes[0]), (candidate.effect.reported(), candidate.where)
        known = best.get(key)
        if np.isfinite(size) and (known is None or (known.parameter == name and size < known.size)):
            u, y = units_at(model, candidate.where)
            dimension = next(p.dimension for p in candidate.effect.parameters() if p.name == name)
            unit = dimension.unit(u, y)
            best[key] = Visible(*key, name, size, unit, None if unit == "1" else float(abs(unit_size)))
    return tuple(best[key] for key in sorted(best))
