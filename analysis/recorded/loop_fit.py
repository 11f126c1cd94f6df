"""The nonlinear model of the paper fitted to a recorded hysteresis test."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.measurements.loop_fit import LoopFit, fit_loops
from analysis.recorded.hysteresis import axis_of, command_of
from campaigns.log import Run
from sim_backend.errors import DataError

Array = NDArray[np.float64]

SAMPLES_PER_LOOP = 1000
"""To how many samples each period is averaged: loops bend over a twentieth of the swing, this is fifty times finer."""

HELD = {"a": 0.44, "ms": 0.44, "alpha": 1e-3, "c": 0.22}
"""As printed (Table 6.3): far from saturation a record tells only two numbers of the loop, see
`measurements/loop_fit.py`."""

STARTS = [{"pinning": pinning} for pinning in (3e-4, 1e-3, 3e-3, 1e-2)]
"""Pinning from far below to beyond the swing."""


def loop_fit_of(run: Run) -> LoopFit:
    """Return the fit to all loops of a run, in their order, so that the magnetic history is followed; Table 6.3.

    Raises DataError for a run without loops.
    """
    axis = axis_of(run)
    loops = [s for s in run.segments if s.settings.get("phase") == "loop"]
    if not loops:
        raise DataError(f"{run.path} holds no loops; record some, as in campaigns/paper.toml")
    command = command_of(run, axis)
    torque: list[Array] = []
    angle: list[Array] = []
    every = max(int(loops[0].settings["period_samples"]) // SAMPLES_PER_LOOP, 1)
    for segment in loops:
        rows = segment.rows // every * every
        for name, into in ((command, torque), (axis, angle)):
            into.append(run.read(name, segment.start, segment.start + rows).reshape(-1, every).mean(axis=1))
    # the first samples of each loop swing in from another history, with inertia: they magnetise but do not count
    use = np.concatenate([np.arange(a.size) >= SAMPLES_PER_LOOP // 4 for a in angle])
    return fit_loops(np.concatenate(torque), np.concatenate(angle), run.sample_rate_hz / every, HELD, STARTS, use)
