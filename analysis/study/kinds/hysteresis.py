"""Trials of slow loops: the remanent displacement at zero torque, and the energy that a cycle dissipates."""

from __future__ import annotations

from collections.abc import Mapping

from analysis.recorded.hysteresis import loops_of
from analysis.study.kinds.base import Column, Scalar
from analysis.study.kinds.played import PlayedTrial, as_log
from campaigns.playing.recording import Recording
from sim_backend.errors import DataError


class HysteresisTrial(PlayedTrial):
    """The plan `hysteresis` without its steps, its widest loop judged as `mccd hysteresis` judges it."""

    name = plan = "hysteresis"
    title = "remanence and area of a hysteresis loop"
    usual = {"offsets_rad": []}  # steps are shown, not measured: a trial would play them for nothing
    columns = (
        Column("remanence_rad", "half the displacement between both passages of zero torque, widest loop"),
        Column("remanence_ratio", "that over the amplitude of the angle"),
        Column("area_j", "energy that a cycle of the widest loop takes"),
    )

    def measured(self, record: Recording) -> Mapping[str, Scalar]:
        """Return the numbers of the loop with the largest torque; raises DataError where no loop was played."""
        loops = loops_of(as_log(record))
        if not loops:
            raise DataError("plan hysteresis: torques_nm is empty, so there is no loop; give at least one torque")
        widest = loops[max(loops)]
        return {
            "remanence_rad": widest.remanence_rad,
            "remanence_ratio": widest.remanence_ratio,
            "area_j": widest.area_j,
        }
