"""Whether a controller answers a reading within its own sample: then feedthrough cannot be identified.

A reading's noise is then in the input of the same sample, times the controller's gain, and a model whose input acts at
once predicts the noise by it: the likelihood rises by thousands, and the model simulates worse. A plant that acts from
the next sample on has no such bias, and the direct method is consistent for it, whatever the loop.

Source: L. Ljung, System Identification, 2nd edition, 1999, sections 13.4 and 13.5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from analysis.identification.timefit import TimeFit
from analysis.identification.whitening import whitening_filters
from sim_backend.linear import Array

_LAGS = 10
_CHANCE = 1e-6
_RATIO, _LEAST = 3.0, 0.02
"""By how much more the inputs to come must hold of the residual than those that went before; at least this part of it.

Of what a model misses of its inputs these hold as much or more, and where an excitation repeats both hold it. A little
follows in a long record of what is not linear, because no filter whitens an excitation of a limited band.
"""


_ALIKE = 1.0
"""Sum of the squared autocorrelations, over so many lags, up to which the innovation of an input is new.

Above it a sample's neighbours hold more of it than it does itself, and what the past of an input holds of a residual
shows in the inputs to come as well. No filter whitens noise of a limited band or smooth steps.
"""


@dataclass(frozen=True)
class Echo:
    """How much a white residual is in the innovations of the inputs a few samples `before` and `after`, against chance.

    Both are sums of as many squares as `tests`, over so many `rows`.
    """

    before: float
    after: float
    tests: int
    rows: int

    @property
    def comes_back(self) -> bool:
        """Whether the inputs answer the residual, and it not them."""
        return self.may_come_back and self.after > _LEAST * self.rows

    @property
    def may_come_back(self) -> bool:
        """Whether they hold more of it afterwards than chance does and than they held before, however little that is.

        An axis that stands still beside others answers its own noise with the little that its controller does.
        """
        return bool(self.after > scipy.stats.chi2.isf(_CHANCE, self.tests) and self.after > _RATIO * self.before)


def answers_at_once(fit: TimeFit, inputs: Sequence[Array], outputs: Sequence[Array]) -> bool:
    """Tell whether what `fit` leaves of the outputs, (n, n_y) each, comes back in the inputs, (n, n_u) each.

    A fit with a delay leaves out the first samples of each record.
    """
    inputs, outputs = (
        [x[x.shape[0] - m.shape[0] :] for x, m in zip(records, fit.outputs, strict=True)]
        for records in (inputs, outputs)
    )
    errors = [y - m for y, m in zip(outputs, fit.outputs, strict=True)]
    echoes = [echo_of(_new([e[:, o] for e in errors], fit.whitening[o]), inputs) for o in range(errors[0].shape[1])]
    before, after, tests = (sum(getattr(echo, name) for echo in echoes) for name in ("before", "after", "tests"))
    return Echo(before, after, tests, echoes[0].rows).comes_back


def echo_of(rest: Sequence[Array], inputs: Sequence[Array]) -> Echo:
    """Return what is new in the `inputs`, (n, n_u) each, holds of the white `rest`, (n,) each, earlier and later.

    A `rest` may lack the first samples of its record. An input that no filter makes white is left out.
    """
    before, after, tests = 0.0, 0.0, 0
    for j in range(inputs[0].shape[1]):
        own = [u[:, [j]] - u[:, j].mean() for u in inputs]
        tests += _LAGS
        if not any(np.any(u) for u in own):
            continue
        fresh = _new([u[:, 0] for u in own], whitening_filters(own, None)[0])
        if _held(fresh, fresh, range(1, _LAGS + 1)) > _ALIKE * sum(f.size for f in fresh):
            continue
        known = [min(r.size, f.size) for r, f in zip(rest, fresh, strict=True)]
        late, new = ([x[x.size - n :] for x, n in zip(some, known, strict=True)] for some in (rest, fresh))
        after += _held(late, new, range(1, _LAGS + 1))
        before += _held(late, new, range(-_LAGS, 0))
    return Echo(before, after, tests, sum(r.size for r in rest))


def _new(signals: Sequence[Array], taps: Array) -> list[Array]:
    """Return what a whitening filter leaves of signals (n,), without the first samples, which it knows no past of."""
    return [np.convolve(x, taps)[min(taps.size - 1, x.size - 1) : x.size] for x in signals]


def _held(rest: Sequence[Array], fresh: Sequence[Array], lags: range) -> float:
    """Return the sum of squared correlations of `rest` with `fresh` so many samples later, relative to chance."""
    total = 0.0
    for lag in lags:
        pairs = [
            (r[max(-lag, 0) : r.size - max(lag, 0)], f[max(lag, 0) : f.size - max(-lag, 0)])
            for r, f in zip(rest, fresh, strict=True)
        ]
        product = sum(float(r @ f) for r, f in pairs)
        powers = sum(float(r @ r) for r, _ in pairs) * sum(float(f @ f) for _, f in pairs)
        total += sum(r.size for r, _ in pairs) * product**2 / max(powers, np.finfo(float).tiny)
    return total
