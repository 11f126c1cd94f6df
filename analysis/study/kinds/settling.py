"""Trials of a fast chop: settling, power and parasitic motion of one strategy on one bench."""

from __future__ import annotations

from collections.abc import Mapping

from analysis.recorded.requirements import PARASITIC_Z_M, PEAK_CURRENT_A, POWER_W, SETTLING_S
from analysis.recorded.settle import settle_of
from analysis.study.kinds.base import Column, Scalar
from analysis.study.kinds.played import PlayedTrial
from campaigns.playing.recording import Recording


class SettlingTrial(PlayedTrial):
    """The plan `settling`, judged as `mccd settle` judges it."""

    name = plan = "settling"
    title = "settling of a fast chop"
    columns = (
        Column("settling_s", "longest settling of all moves to within ±1.7 µrad", limit=SETTLING_S),
        Column("stability_3sigma_rad", "largest 3σ of position in the last part of each dwell"),
        Column("power_w", "mean dissipation in all coils", limit=POWER_W),
        Column("peak_current_a", "largest current of any coil", limit=PEAK_CURRENT_A),
        Column("parasitic_z_m", "largest excursion of z", limit=PARASITIC_Z_M),
    )

    def measured(self, record: Recording) -> Mapping[str, Scalar]:
        """Return the longest settling, and what else the requirements ask of a fast chop."""
        test = settle_of(record)
        return {
            "settling_s": test.settling_s,
            "stability_3sigma_rad": test.stability.stability_rad,
            "power_w": None if test.power is None else test.power.total_w,
            "peak_current_a": None if test.power is None else test.power.peak_a,
            "parasitic_z_m": test.parasitic_z_m,
        }
