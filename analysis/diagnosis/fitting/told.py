"""What a model leaves however its numbers are tuned, rows told that no fit had seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.fitting.balance import again
from analysis.diagnosis.fitting.fit import Fit, Setting, linear_of, residuals_on
from analysis.diagnosis.fitting.starts import starts_of
from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.records.dataset import Dataset

Array = NDArray[np.float64]


def left_however_tuned(data: Dataset, setting: Setting, fit: Fit, noise: Whitener) -> Sequence[Array]:
    """Return what a model leaves (n, n_y) of every record of `data` in that noise, `fit` told all held-out rows.

    Numbers are known to what the fitted rows told of them. On rows of another motion that may be an error of many
    noises which follows the motion; it is none of the model as long as numbers that suit all rows leave none.
    """
    told = tuple(replace(r, windows=tuple(replace(w, held_out=False) for w in r.windows)) for r in data.records)
    known = {id(r.y): state for r, state in zip(setting.data.records, setting.states, strict=True)}
    rest = np.zeros((setting.nominal.n_blocks, 2))
    setting = replace(
        setting,
        data=replace(data, records=told),
        whitener=noise,
        states=tuple(known.get(id(r.y), rest) for r in told),
        begin=fit.change,
    )
    setting = replace(setting, starts=starts_of(setting.data, linear_of(setting, fit), noise))
    return residuals_on(setting.data, setting, again(setting, fit))
