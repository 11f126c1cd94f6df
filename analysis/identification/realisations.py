"""Segments that hold whole periods of one signal, side by side as realisations of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.recorded.folded import folded, together
from analysis.recorded.settled import settling_periods
from campaigns.log import LogSegment, Run

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Realisations:
    """Periodic data (sample, channel, realisation, mean of `group` periods) at one rate, transient periods left out."""

    inputs: Array
    outputs: Array
    rate_hz: float
    group: int


def realisations_of(parts: Sequence[tuple[Run, LogSegment]]) -> Realisations | None:
    """The segments as realisations, when all have one period and there is one realisation per input at least."""
    n_u = len(parts[0][0].names("input"))
    periods = {int(s.settings.get("period_samples", 0)) for _, s in parts}
    if len(periods) != 1 or 0 in periods or len(parts) < n_u or any("frequency_hz" in s.settings for _, s in parts):
        return None
    period = periods.pop()
    count = min(s.rows // period for _, s in parts)
    skip = settling_periods(parts, period, count)
    stated = any("transient_periods" in s.settings for _, s in parts)
    count -= skip
    # a start that rings on into the last period but one leaves nothing that repeats: the records tell more in time
    if count <= 0 or (count == 1 and skip and not stated):
        return None
    group, settled = together(parts, period, count), [(r, replace(s, start=s.start + skip * period)) for r, s in parts]
    blocks = [np.stack([folded(r, s, role, period, count, group) for r, s in settled]) for role in ("input", "output")]
    inputs, outputs = (block.transpose(2, 3, 0, 1) for block in blocks)
    data = Realisations(inputs, outputs, parts[0][0].sample_rate_hz, group)
    return None if _drifting(data) else data


def noise_power(data: Realisations) -> Array:
    """Return the mean square (n_y,) of one period's noise at all frequencies; NaN of a single period."""
    if data.outputs.shape[3] < 2:
        return np.full(data.outputs.shape[1], np.nan)
    return np.asarray(np.var(data.outputs, axis=3, ddof=1).mean(axis=(0, 2)) * data.group)


def _drifting(data: Realisations) -> bool:
    """Tell whether an output moves farther from period to period than within one: a free axis does not repeat.

    Between periods its drift would be taken for noise, and hide everything that repeats.
    """
    if data.outputs.shape[3] < 2:
        return False
    farther = np.abs(np.diff(data.outputs.mean(axis=0), axis=2)).mean(axis=(1, 2)) / data.group
    within = np.ptp(data.outputs.mean(axis=3), axis=0).mean(axis=1)
    # within a period a steady drift goes as far as from one to the next, and the swing comes on top of it
    return bool(np.any(farther > 0.5 * within))


def bring_to_one_level(data: Realisations) -> None:
    """Scale every realisation to the same rms of the input, in place: of thousands there is memory for one copy.

    A linear response does not change by that. A bench that is not linear answers each level in its own way; unscaled,
    the loudest level would decide what is the best linear model of all.
    """
    rms = np.sqrt(np.mean(data.inputs**2, axis=(0, 1, 3), keepdims=True))
    if np.any(rms == 0.0):
        return
    scale = rms.mean() / rms
    for values in (data.inputs, data.outputs):
        values *= scale
