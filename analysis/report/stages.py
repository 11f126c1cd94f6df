"""What each piece of knowledge gained on the bench of a report, as a table of the page and a CSV file."""

from __future__ import annotations

import numpy as np

from analysis.design.stages import ALPHA_DEG, STAGES, StageResult
from analysis.paper.measured import Measured
from analysis.recorded.settle import FORCE_CONSTANT_N_A, STEEPNESS_N_SQRT_W
from sim_backend.errors import DataError


def measured_stages(measured: Measured) -> list[StageResult]:
    """Return a row for every axis and designed strategy that was played; an empty list without a design."""
    rows = []
    for axis, alpha in ALPHA_DEG.items():
        for strategy in STAGES:
            phase = measured.settle(strategy, alpha)
            if phase is None:
                continue
            settled = phase.settling(axis)
            try:
                peak_a = phase.power(FORCE_CONSTANT_N_A, STEEPNESS_N_SQRT_W).peak_a
            except DataError:  # a bench that measures no currents
                peak_a = float("nan")
            rows.append(
                StageResult(
                    axis,
                    strategy,
                    float(np.max(settled.time_s)),
                    float(np.max(settled.overshoot)),
                    phase.stability().stability_rad,
                    peak_a,
                    phase.run.run_uid,
                )
            )
    return rows
