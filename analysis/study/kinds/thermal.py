"""Trials of a long chop: how far its positions drift while the mechanism warms up."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from analysis.recorded.drift import drift_of
from analysis.recorded.requirements import THERMAL_STABILITY_RAD
from analysis.study.kinds.base import Column, Scalar
from analysis.study.kinds.played import PlayedTrial, as_log
from campaigns.playing.recording import Recording


class ThermalTrial(PlayedTrial):
    """The plan `thermal`, judged as the chop of `mccd thermal` is."""

    name = plan = "thermal"
    title = "drift during a long chop"
    columns = (
        Column("drift_rad", "largest drift of both positions and axes over the test", limit=THERMAL_STABILITY_RAD),
        Column("half_width_rad", "largest half width of its 95 % interval"),
        Column("significant", "a drift whose 95 % interval leaves zero out", kind="flag"),
        Column("warming_k", "rise of the temperature"),
    )

    def measured(self, record: Recording) -> Mapping[str, Scalar]:
        """Return the worst of both positions and axes."""
        test = drift_of(as_log(record))
        return {
            "drift_rad": max(float(np.max(np.abs(one.total_rad))) for one in test.drift),
            "half_width_rad": max(float(np.max(one.half_width_rad)) for one in test.drift),
            "significant": any(bool(np.any(one.significant)) for one in test.drift),
            "warming_k": test.warming_k,
        }
