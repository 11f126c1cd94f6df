"""What the outputs change by per unit of everything that is fitted already: others are screened beside that."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.candidates.parameters import parameters_of
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.fitting.refit import Problem
from analysis.diagnosis.nominal.tuning import sensitivities, turned
from sim_backend.linear import ModalModel

Array = NDArray[np.float64]


def exact_sensitivities(setting: Setting, fit: Fit) -> tuple[Array, ...]:
    """Return, per record, the outputs' change per unit of each knob and each effect parameter, (n, n_y, k).

    By differences of the full simulation: what is screened beside these columns is compared with noise, and an error of
    a thousandth in a knob's column can be far above it.
    """
    held, sizes = fit.held()
    scales, x = parameters_of(held, sizes)
    problem = Problem(setting, tuple(held), scales)
    x = np.concatenate([fit.change, x])
    if not (held or setting.known):
        return plain_sensitivities(setting, turned(setting.nominal, setting.knobs, fit.change))
    here, _ = problem.raw(x)  # the starts may have been found anew since the fit

    def column(i: int) -> list[Array]:
        found = problem.slope(x, i, here)
        return [np.zeros_like(r) for r in here] if found is None else [-slope for slope in found]

    with ThreadPoolExecutor(setting.workers) as pool:
        columns = list(pool.map(column, range(x.size)))
    return tuple(np.stack([c[r] for c in columns], axis=2) for r in range(len(setting.data.records)))


def plain_sensitivities(setting: Setting, linear: ModalModel) -> tuple[Array, ...]:
    """Return, per record, the change of the outputs of `linear` by itself per unit of each knob, (n, n_y, k)."""
    return tuple(
        sensitivities(linear, setting.knobs, record.u, setting.data.rate_hz, states)
        for record, states in zip(setting.data.records, setting.states, strict=True)
    )
