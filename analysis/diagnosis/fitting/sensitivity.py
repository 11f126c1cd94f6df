"""What the outputs change by per unit of everything that is fitted already: others are screened beside that."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.candidates.parameters import parameters_of
from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.fitting.problem import Problem
from analysis.diagnosis.fitting.refit import in_parts, sizes_of_each
from analysis.diagnosis.nominal.responses import stacked
from analysis.diagnosis.nominal.tuning import sensitivities, turned
from sim_backend.linear import ModalModel

Array = NDArray[np.float64]


def exact_sensitivities(setting: Setting, fit: Fit) -> tuple[Array, ...]:
    """Return, per record, the outputs' change per unit of each knob and each effect parameter, (n, n_y, k).

    By differences of the full simulation: what is screened beside these columns is compared with noise, and an error of
    a thousandth in a knob's column can be far above it.
    """
    held, sizes = fit.held()
    if not (held or setting.known):
        return plain_sensitivities(setting, turned(setting.nominal, setting.knobs, fit.change))
    scales, _ = parameters_of(held, sizes)
    n_knobs = len(setting.knobs)
    out = tuple(np.zeros((n_knobs + len(scales), *r.y.shape[::-1])).T for r in setting.data.records)
    each = sizes_of_each(held, sizes)
    for part, own in in_parts(setting, held, sizes):
        chosen = [held[i] for i in part.candidates]
        begins = np.concatenate([np.zeros(0), *(each[i] for i in part.candidates)])
        columns = [*part.knobs, *(n_knobs + k for k, s in enumerate(scales) if s.effect in part.candidates)]
        for record, found in zip(out, _exact(own, chosen, begins, fit.change[part.knobs]), strict=True):
            record[:, part.outputs[:, None], columns] = found
    return out


def _exact(setting: Setting, held: Sequence[Candidate], sizes: Array, change: Array) -> list[Array]:
    """Return, per record, the columns of knobs and effect parameters of what is taken as one, (n, n_y, k)."""
    scales, start = parameters_of(held, sizes)
    problem = Problem(setting, tuple(held), scales)
    x = np.concatenate([change, start])
    here, _ = problem.raw(x)  # the starts may have been found anew since the fit

    def column(i: int) -> list[Array]:
        # the slope by a step of rounding is that of a gain as long as no number is rounded otherwise: beside it a gain
        # would go anywhere
        fixed = i >= change.size and held[scales[i - change.size].effect].effect.whole
        found = None if fixed else problem.slope(x, i, here)
        return [np.zeros_like(r) for r in here] if found is None else [-slope for slope in found]

    with ThreadPoolExecutor(setting.workers) as pool:
        columns = list(pool.map(column, range(x.size)))
    empty = [np.zeros((*r.shape, 0)) for r in here]
    return [stacked([c[r] for c in columns]) if columns else empty[r] for r in range(len(here))]


def plain_sensitivities(setting: Setting, linear: ModalModel) -> tuple[Array, ...]:
    """Return, per record, the change of the outputs of `linear` by itself per unit of each knob, (n, n_y, k)."""
    return tuple(
        sensitivities(linear, setting.knobs, record.u, setting.data.rate_hz, states)
        for record, states in zip(setting.data.records, setting.states, strict=True)
    )
