"""What the errors of the tuned numbers add to held-out rows, where something else may be played than what tuned them.

Lines at a few frequencies leave a mode's numbers nearly as the nominal model has them, a few per cent wrong. Rows that
shake it elsewhere then show that error, and a cause that is right seems to be of another size there.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy

from analysis.diagnosis.fitting.fit import Fit, Setting, linear_of
from analysis.diagnosis.fitting.starts import stack_white
from analysis.diagnosis.nominal.tuning import root_of, turning
from analysis.diagnosis.records.dataset import Dataset
from sim_backend.linear import Array


def tuning_errors(data: Dataset, setting: Setting, fit: Fit) -> Mapping[int, Array]:
    """Return what uncorrelated errors of one standard deviation add to each record with held-out rows, by its number.

    Shape (n, n_y, k) for k tuned numbers. Their covariance is that of the fitted rows and of the prior, to first order
    along the linear model, in noise as large as the fit leaves it.
    """
    linear = linear_of(setting, fit)
    turn = turning(linear, setting.nuisances, data.rate_hz)
    rest = np.zeros((linear.n_blocks, 2))
    root = root_of(setting.nuisances)
    precision = root.T @ root
    for record, start in zip(setting.data.records, setting.starts, strict=True):
        seen = start.project(stack_white(setting.whitener, record, turn.columns(record.u, rest)))
        precision += seen.T @ seen / max(1.0, fit.misfit / max(fit.rows, 1))
    # errors e of this precision P = L L' are L'^-1 times uncorrelated ones
    lower = np.linalg.cholesky(precision)
    held_out = {i: record for i, record in enumerate(data.records) if record.held_out().any()}
    columns = {i: turn.columns(record.u, rest) for i, record in held_out.items()}
    return {
        i: np.asarray(scipy.linalg.solve_triangular(lower, values.reshape(-1, lower.shape[0]).T, lower=True)).T.reshape(
            values.shape
        )
        for i, values in columns.items()
    }
