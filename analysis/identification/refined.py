"""A model from a response, refined by a fit in time to the records, which are free of the response's leakage.

Periods that still hold the end of a start, and pieces shorter than a mode rings, make lines of a light mode a little
wrong, all of them alike, so that the scatter does not show it. In time every segment has a start of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.identification.determined import without_undetermined
from analysis.identification.held_out import error_of_free_run
from analysis.identification.in_time import late_and_determined
from analysis.identification.modal_parameters import Structure
from analysis.identification.timefit import TimeFit, fit_records
from analysis.identification.whole_delay import freed
from sim_backend.linear import Array, ModalModel

MOST = 10_000_000
"""Limit on samples times parameters for the refinement: 100,000 samples of two modes take a few seconds."""

_ITERATIONS = 30


def refined(
    model: ModalModel,
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    rate_hz: float,
    structure: Structure,
    offset: Array,
    *,
    late: bool,
) -> TimeFit | None:
    """Return the fit in time from `model` to records (n, n_u) and (n, n_y), None where it is no better there.

    Better is a smaller residual in free run, over all records. A mode that is undetermined in time is given up. Whole
    samples of the model's delays are kept; if the bench may be `late`, a fraction of a sample is fitted beside them.
    `offset` (n_y,) is what each output reads where the model is at rest.
    """
    numbers = (model.n_blocks * 2 + 1) * (model.n_inputs + model.n_outputs)
    if sum(u.shape[0] for u in inputs) * numbers > MOST:
        return None
    whole = np.floor(model.delay_s * rate_hz + 1e-6).astype(np.intp)
    us, ys = freed(inputs, outputs, whole, int(whole.max(initial=0)))
    part = model.delay_s - whole / rate_hz if structure.delay else np.zeros(whole.size)
    bare = model.with_(delay_s=part)

    def again(blocks: int, start: ModalModel | None) -> TimeFit:
        return fit_records(
            us, ys, rate_hz, blocks, structure=structure, rigid_bodies=None, start=start, iterations=_ITERATIONS
        )

    fit = again(bare.n_blocks, bare)
    before = sum(error_of_free_run(bare, u, y - offset, rate_hz) for u, y in zip(us, ys, strict=True))
    after = sum(float(np.sum(((m - y) / y.std(axis=0)) ** 2)) for m, y in zip(fit.outputs, ys, strict=True))
    if after >= before:
        return None
    fit = without_undetermined(fit, (1,), again, anew=False)
    fit = replace(fit, model=fit.model.with_(delay_s=fit.model.delay_s + whole / rate_hz))
    return late_and_determined(fit, inputs, outputs, rate_hz, (1,)) if late else fit
