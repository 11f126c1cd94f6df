"""What the errors of the adjusted parameters add to held-out samples, whose excitation may differ from the fitted one.

Excitation at a few frequencies leaves the parameters of a mode nearly at their nominal values, a few per cent wrong.
Samples that excite it elsewhere then show that error, and a right cause seems to be of another size there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

import numpy as np
import scipy

from analysis.diagnosis.fitting.fit import Fit, Setting, linear_of
from analysis.diagnosis.fitting.starts import stack_white
from analysis.diagnosis.nominal.tuning import root_of, turning
from analysis.diagnosis.records.dataset import Dataset
from sim_backend.linear import Array


def tuning_errors(data: Dataset, setting: Setting, fit: Fit) -> Mapping[int, Array]:
    """Return what uncorrelated errors of one standard deviation add to each record with held-out samples, by number.

    Shape (n, n_y, k) for k adjusted parameters. Their covariance is that of the fitted samples and of the prior, to
    first order along the linear model, with noise as large as the residual of the fit.
    """
    linear, count = linear_of(setting, fit), len(setting.nuisances)
    if not count:
        return {}
    turn = turning(linear, setting.nuisances, data.rate_hz)
    rest, noise = np.zeros((linear.n_blocks, 2)), np.sqrt(max(1.0, fit.misfit / max(fit.rows, 1)))
    # a record may be fitted in some samples and held out in others: it is simulated once
    held_out = {id(record.y): i for i, record in enumerate(data.records) if record.held_out().any()}
    columns: dict[int, Array] = {}
    # R with R'R = the information of prior and samples: products of columns would lose what the prior alone tells
    root = root_of(setting.nuisances)
    for record, start in zip(setting.data.records, setting.starts, strict=True):
        own = turn.columns(record.u, rest)
        if id(record.y) in held_out:
            columns[held_out[id(record.y)]] = own
        seen = start.project(stack_white(setting.whitener, record, own))
        root = cast(Array, np.linalg.qr(np.concatenate([root, seen / noise]), mode="r"))
    columns |= {i: turn.columns(data.records[i].u, rest) for i in held_out.values() if i not in columns}
    # errors of that information are R^-1 times uncorrelated ones
    flat = {i: values.reshape(-1, count).T for i, values in columns.items()}
    errors = {i: scipy.linalg.solve_triangular(root, values, trans="T").T for i, values in flat.items()}
    return {i: np.asarray(values).reshape(columns[i].shape) for i, values in errors.items()}
