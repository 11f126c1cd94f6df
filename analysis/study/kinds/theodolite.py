"""Trials of the angle sensors: their gain against an independent instrument."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from analysis.recorded.requirements import ACCURACY_RAD, FULL_ANGLE_RAD
from analysis.recorded.sensors import theodolite_of
from analysis.study.kinds.base import Column, Scalar, Setup
from analysis.study.kinds.played import PlayedTrial, as_log
from campaigns.playing.recording import Recording
from sim_backend.errors import ConfigError


class TheodoliteTrial(PlayedTrial):
    """The plan `theodolite`, judged as `mccd theodolite` judges it."""

    name = plan = "theodolite"
    title = "gain of the sensors against a theodolite"
    columns = (
        Column("gain_correction_theta_x", "gain of the instrument over that of the sensor, less one, θx"),
        Column("gain_correction_theta_y", "the same, θy"),
        Column("error_rad", "what the larger means at the full angle", limit=ACCURACY_RAD),
    )

    def decides(self, setup: Setup) -> Mapping[str, Any]:
        """Return what every played trial does; raises ConfigError too for a bench without the instrument."""
        hardware = setup.nominal.hardware
        if hardware is None or hardware.theodolite_noise_rad is None:
            raise ConfigError(
                f"model '{setup.nominal.name}' has no theodolite; give its hardware a theodolite_noise_rad, or study "
                "one that has, such as as-built"
            )
        return super().decides(setup)

    def measured(self, record: Recording) -> Mapping[str, Scalar]:
        """Return the corrections of both angles, and the error they mean."""
        gain_x, gain_y = theodolite_of(as_log(record)).calibration.gain_correction.tolist()
        return {
            "gain_correction_theta_x": gain_x,
            "gain_correction_theta_y": gain_y,
            "error_rad": float(np.max(np.abs([gain_x, gain_y]))) * FULL_ANGLE_RAD,
        }
