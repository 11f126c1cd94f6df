"""A stepped sine is checked for the facts of its record as every other log is, on the axis that it drives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.identification.identified import Identification
from analysis.identification.identify import identify_runs
from campaigns.log import LogWriter, read_run
from sim_backend.bench import Signal
from sim_backend.errors import DataError
from sim_backend.linear import ModalModel, discretise

Array = NDArray[np.float64]

RATE_HZ, SAMPLES = 2000.0, 2000
STEPS_HZ = np.array([5.0, 10.0, 15.0, 18.0, 19.0, 20.0, 21.0, 22.0, 25.0, 30.0, 40.0, 50.0])
RESONANCE_HZ = 20.0
PLANT = ModalModel(
    np.array([2.0 * np.pi * RESONANCE_HZ]),
    np.array([6.0]),
    np.ones((1, 1)),
    np.zeros((1, 1)),
    np.full((1, 1), 3000.0),
    np.zeros((1, 1)),
    np.zeros((1, 1)),
    np.zeros(1),
)


def swept(path: Path, limit: float = np.inf, share: float = np.inf, resting: tuple[float, ...] = ()) -> Path:
    """Write steady sines read by a sensor that ends at ±`limit` or at a `share` of each sine; y always rests.

    In `resting` steps x rests too.
    """
    plant, rng = discretise(PLANT, RATE_HZ), np.random.default_rng(3)
    names = (("torque_x", "N m", "input", "x"), ("x", "rad", "output", "x"), ("y", "rad", "output", "y"))
    t = np.arange(SAMPLES) / RATE_HZ
    channels = [Signal(name, unit, role, dof, RATE_HZ) for name, unit, role, dof in names]  # type: ignore[arg-type]
    with LogWriter.create(path, channels, test="sinesweep", bench={"kind": "file", "name": "other"}) as log:
        for f in STEPS_HZ.tolist():
            g = plant.frequency_response(np.array([f]))[0, 0, 0]
            torque = 1e-3 * np.cos(2.0 * np.pi * f * t)
            x = 1e-3 * np.abs(g) * np.cos(2.0 * np.pi * f * t + np.angle(g)) + 1e-7 * rng.standard_normal(SAMPLES)
            x = (
                np.zeros(SAMPLES)
                if f in resting
                else np.clip(x, -(end := min(limit, share * 1e-3 * float(np.abs(g)))), end)
            )
            with log.segment(f"{f:g} Hz", {"axis": "x", "frequency_hz": f, "measure_from": 200}):
                log.append({"torque_x": torque, "x": x, "y": np.zeros(SAMPLES)})
    return path


def identified(path: Path) -> Identification:
    with read_run(path) as run:
        return identify_runs([run])


def test_a_good_sweep_has_no_remark(tmp_path):
    """Nor is one made of the axis beside, which rests as it should."""
    assert identified(swept(tmp_path / "run.h5")).remarks == ()


def test_a_step_at_rest_is_left_out_and_told(tmp_path):
    found = identified(swept(tmp_path / "run.h5", resting=(15.0, 40.0)))
    assert found.response[0].frequency_hz.tolist() == [f for f in STEPS_HZ.tolist() if f not in (15.0, 40.0)]
    assert found.modes[0]["frequency_hz"] == pytest.approx(RESONANCE_HZ, rel=1e-4)
    told = [remark for remark in found.remarks if "left out" in remark]
    assert len(told) == 2 and all(remark.startswith("run.h5: x is 0 in all of") for remark in told)


def test_a_step_that_the_sensor_cuts_off_is_left_out_and_told(tmp_path):
    """The resonance is beyond the sensor's range: cut off, it would look damped."""
    peak = 1e-3 * float(np.abs(PLANT.frequency_response(np.array([RESONANCE_HZ]), RATE_HZ))[0, 0, 0])
    found = identified(swept(tmp_path / "run.h5", limit=0.7 * peak))
    assert RESONANCE_HZ not in found.response[0].frequency_hz
    assert found.modes[0]["decay_rate_1_s"] == pytest.approx(6.0, rel=1e-3)
    assert any("x is cut off" in remark for remark in found.remarks)


def test_a_sweep_of_which_nothing_is_left_is_refused(tmp_path):
    with pytest.raises(DataError, match="output 'x' is constant"):
        identified(swept(tmp_path / "rest.h5", resting=tuple(STEPS_HZ.tolist())))
    with pytest.raises(DataError, match="cut off by its sensor or at rest in all 12 steps"):
        identified(swept(tmp_path / "cut.h5", share=0.7))
