"""The most significant curve of the evidence, by its chance under noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from analysis.diagnosis.result import Domain


def least_by_chance(evidence: Mapping[str, Sequence[Domain]]) -> tuple[float, str, Domain] | None:
    """Return the curve with the least p-value, its domain, and that p-value times the number of curves there.

    The p-value comes first. Of equals it is the curve that rises highest above its floor; None without a curve.
    """
    found = [
        (min(len(curves) * curve.p_value, 1.0), -_height(curve), name, curve)
        for name, curves in evidence.items()
        for curve in curves
    ]
    if not found:
        return None
    p, _, name, curve = min(found, key=lambda one: one[:3])
    return p, name, curve


def _height(curve: Domain) -> float:
    """Return the largest level of a curve in units of its floor; zero where none is known."""
    ratio = curve.level / np.where(curve.floor > 0.0, curve.floor, np.inf)
    return float(np.max(ratio[np.isfinite(ratio)], initial=0.0))
