"""Two modes in one place: kept as one where held-out data need no second.

A mode whose frequency changes with its amplitude is fitted better by two linear ones, but in the fitted data only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from analysis.identification.determined import dropped_from, same_place
from analysis.identification.dropped import MERGED
from analysis.identification.identified import HeldOut
from analysis.identification.response_fit import RationalFit
from analysis.identification.timefit import TimeFit
from sim_backend.linear import ModalModel

_AnyFit = TypeVar("_AnyFit", TimeFit, RationalFit)


def with_pairs_merged(
    fit: _AnyFit,
    orders: tuple[int, ...],
    again: Callable[[int, ModalModel], _AnyFit],
    held_out: Callable[[_AnyFit], Sequence[HeldOut]],
) -> _AnyFit:
    """Return the fit with one mode for two in one place, fitted `again`, where no error on `held_out` data grows by it.

    Without held-out data nothing tells whether both are needed, and the fit is returned as it is. So it is where the
    number of modes is given: `orders` is then that number alone.
    """
    error = _error(held_out(fit)) if len(orders) > 1 and same_place(fit.model) else None
    while error is not None:
        better = None
        for pair in same_place(fit.model):
            # of the two the one that does less is given up
            i = min(pair, key=lambda k: float(np.linalg.norm(fit.model.c[:, k]) * np.linalg.norm(fit.model.b[k])))
            fewer = again(fit.model.n_blocks - 1, fit.model.only(np.arange(fit.model.n_blocks) != i))
            now = _error(held_out(fewer))
            if now is not None and now <= error:
                better = replace(fewer, dropped=(*fit.dropped, dropped_from(fit, i, fewer, MERGED)))
                error = now
                break
        if better is None:
            break
        fit = better
    return fit


def _error(held_out: Sequence[HeldOut]) -> float | None:
    """Return the rms of the errors on held-out segments, None without any."""
    return float(np.sqrt(np.mean([one.total**2 for one in held_out]))) if held_out else None
