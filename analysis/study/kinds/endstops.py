"""Trials against the end stops: the noise of the position sensors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from analysis.measurements.endstop import NOISE_LIMIT_M
from analysis.recorded.sensors import endstops_of
from analysis.study.kinds.base import Column, Scalar, Setup
from analysis.study.kinds.played import PlayedTrial, as_log
from campaigns.playing.recording import Recording
from sim_backend.errors import ConfigError


class EndstopsTrial(PlayedTrial):
    """The plan `endstops`, judged as `mccd endstops` judges it."""

    name = plan = "endstops"
    title = "noise of the sensors against the end stops"
    columns = (
        Column("noise_3sigma_m", "largest 3σ of a sensor in any position", limit=NOISE_LIMIT_M),
        Column("drift_m_s", "largest drift of a sensor in any position"),
    )

    def decides(self, setup: Setup) -> Mapping[str, Any]:
        """Return what every played trial does; raises ConfigError too for a bench without sensor heads."""
        if setup.nominal.hardware is None:
            raise ConfigError(
                f"model '{setup.nominal.name}' has no hardware, so no sensor whose noise is known in metres; "
                "study one that has, such as as-built"
            )
        return super().decides(setup)

    def measured(self, record: Recording) -> Mapping[str, Scalar]:
        """Return the worst of all positions and sensors."""
        noise = endstops_of(as_log(record)).noise
        return {"noise_3sigma_m": noise.worst_m, "drift_m_s": float(np.max(np.abs(noise.drift_m_s)))}
