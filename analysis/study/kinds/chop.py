"""Trials of a slow chop: stability, repeatability and accuracy of one strategy on one bench."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from analysis.recorded.chop import chop_phase
from analysis.recorded.requirements import ACCURACY_RAD, REPEATABILITY_RAD, STABILITY_RAD
from analysis.study.kinds.base import Column, Scalar
from analysis.study.kinds.played import PlayedTrial
from campaigns.playing.recording import Recording


class ChopTrial(PlayedTrial):
    """The plan `chop`, judged as `mccd chop` judges it."""

    name = plan = "chop"
    title = "stability, repeatability and accuracy of a chop"
    columns = (
        Column("stability_3sigma_rad", "largest 3σ of both positions and axes", limit=STABILITY_RAD),
        Column(
            "repeatability_rad", "largest distance of a window's mean from the mean of all", limit=REPEATABILITY_RAD
        ),
        Column("accuracy_rad", "largest distance of a mean position from the command", limit=ACCURACY_RAD),
        Column("inside_percent", "samples within 1.7 µrad of their mean position, at the worse position"),
    )

    def measured(self, record: Recording) -> Mapping[str, Scalar]:
        """Return the worst of both positions and axes."""
        result = chop_phase(record).stability()
        return {
            "stability_3sigma_rad": result.stability_rad,
            "repeatability_rad": float(np.max(result.repeatability_rad)),
            "accuracy_rad": float(np.max(result.accuracy_rad)),
            "inside_percent": float(np.min(result.inside_percent)),
        }
