"""Channels that an import has interpolated: the method, the samples without a reading, and the error.

No later look at the samples shows it: the import says so, and the log keeps it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from campaigns.facts.base import Array, Fact

NAME = "resampled"

LARGE = 0.01
"""Error against rms from which on it is remarked, as the step of a converter is."""


BESIDE = 0.5 + 1e-6
"""Sample periods between a sample and a reading up to which the sample has that reading."""


@dataclass(frozen=True)
class Resampling:
    """How a channel of `readings` readings came to `samples` samples: method, and error as a share of its rms.

    `drawn` samples have no reading within half a sample period, at most `longest` of them in a row. The error is NaN
    where it is unknown.
    """

    method: str
    readings: int
    samples: int
    drawn: int
    longest: int
    error: float


def resampling(time_s: Array, grid_s: Array, method: str, error: float) -> Resampling:
    """Return what became of readings at `time_s` (n,), ascending, on a uniform grid (m,) of two samples or more."""
    last = grid_s.size - 1
    period_s = float(grid_s[-1] - grid_s[0]) / last
    place = np.concatenate([[-np.inf], (time_s - grid_s[0]) / period_s, [np.inf]])
    # between two readings: a reading at half a period belongs to either sample, however it was rounded
    first = np.maximum(np.floor(place[:-1] + BESIDE) + 1.0, 0.0)
    stop = np.minimum(np.ceil(place[1:] - BESIDE), last + 1.0)
    drawn = np.maximum(stop - first, 0.0)
    return Resampling(method, time_s.size, grid_s.size, int(drawn.sum()), int(drawn.max()), error)


def fact(channel: str, part: str, segment: str, found: Resampling) -> Fact:
    """Return the fact on a channel of a part of a record, of all of it where `part` is empty.

    `segment` is the one that the part is, empty where it is several.
    """
    known = not math.isnan(found.error)
    of_part = f' of part "{part}"' if part else ""
    text = (
        f"{channel}{of_part}: {found.readings} readings were resampled to "
        f"{found.samples} samples ({found.method}); "
        + (f"{found.drawn} have no reading nearby, at most {found.longest} in a row; " if found.drawn else "")
        + (f"the error is about {100.0 * found.error:.2g} % of its rms" if known else "the error is unknown")
    )
    numbers = {
        "readings": found.readings,
        "samples": found.samples,
        "drawn": found.drawn,
        "longest": found.longest,
    } | ({"error": found.error} if known else {})
    return Fact(
        NAME,
        text,
        "identify and diagnose take interpolated samples as measured: their error looks like noise and nonlinearity",
        channel,
        segment,
        numbers,
        remark=bool(found.drawn) or not known or found.error > LARGE,
    )
