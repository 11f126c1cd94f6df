"""Whether the inputs of a recorded bench act at once or late: a fit with a delay beside one without."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.identification.determined import SIGNIFICANT, determinedness
from analysis.identification.timefit import TimeFit, fit_records
from sim_backend.linear import Array

_CLEARLY = 2.0 * float(np.log(99.0))
"""By how much the criterion (twice a logarithm of evidence) must fall: a hundred to one."""


def with_delay(fit: TimeFit, inputs: Sequence[Array], outputs: Sequence[Array], rate_hz: float) -> TimeFit:
    """Return `fit`, or one of as many modes whose inputs act late where that explains the records clearly better.

    Shapes: every record's input (n, n_u) and output (n, n_y). Without a delay its modes imitate it as well as they can;
    what they cannot would be found later as a delay that the bench has and the model lacks. With several inputs only
    the neighbourhood of `fit` is searched, as whole samples of delay at each take too long to try.
    """
    start = None if inputs[0].shape[1] == 1 else fit.model
    delayed = replace(fit.structure, delay=True)
    late = fit_records(inputs, outputs, rate_hz, fit.model.n_blocks, structure=delayed, rigid_bodies=None, start=start)
    clearly = late.criterion + _CLEARLY < fit.criterion
    # a mode that nobody knows is no price for a delay
    doubtful = [int(np.sum(determinedness(one) < SIGNIFICANT)) for one in (late, fit)]
    return late if clearly and bool(np.all(_known(late))) and doubtful[0] <= doubtful[1] else fit


def _known(fit: TimeFit) -> NDArray[np.bool_]:
    """Return which delays (n_u,) are none, or differ from none by what is no uncertainty of theirs.

    Where no linear model explains the record, the evidence counts a little help as much.
    """
    std = np.sqrt(np.diag(fit.covariance)[fit.layout.index("delay_s")])
    return (fit.model.delay_s == 0.0) | (fit.model.delay_s >= SIGNIFICANT * std)
