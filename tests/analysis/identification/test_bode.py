"""The Bode picture shows what was measured where something was played, and the model through it."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.identification.bode import bode, curves_of_run, measured_curves, save_bode
from analysis.identification.identify import identify_runs
from analysis.identification.response_curves import ResponseCurve
from analysis.linear.simulate import simulate_linear
from campaigns.log import Channel, LogWriter, read_run
from campaigns.log.plot import require_picture
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel, discretise

RATE_HZ = 500.0


@pytest.fixture
def log(tmp_path):
    rng = np.random.default_rng(3)
    omega, one, zero = 2 * np.pi * 20.0, np.ones((1, 1)), np.zeros((1, 1))
    plant = ModalModel(
        np.array([omega]), np.array([0.05 * omega]), omega**2 * one, zero, 0.1 * one, zero, zero, np.zeros(1)
    )
    u = rng.standard_normal((6000, 1))
    y = simulate_linear(discretise(plant, RATE_HZ), u)
    channels = [Channel("u", "N m", "input", "a", RATE_HZ), Channel("y", "rad", "output", "a", RATE_HZ)]
    path = tmp_path / "a.h5"
    with LogWriter.create(path, channels, test="t", bench={"kind": "imported", "name": "n"}) as writer:
        with writer.segment("noise", {}):
            writer.append({"u": u[:5000, 0], "y": y[:5000, 0] + 1e-4 * rng.standard_normal(5000)})
        with writer.segment("held-out", {}):
            writer.append({"u": u[5000:, 0], "y": y[5000:, 0]})
    return path


def test_dots_lie_on_the_line_where_the_model_is_right(log, tmp_path):
    with read_run(log) as run:
        found = identify_runs([run], modes=1)
        (curve,) = measured_curves(found, [run])
        save_bode(found, [run], tmp_path / "bode.png")
    with pytest.raises(ConfigError, match="not overwritten"):
        require_picture(tmp_path / "bode.png", force=False)
    require_picture(tmp_path / "bode.png", force=True)
    with pytest.raises(ConfigError, match="not a picture format"):
        require_picture(tmp_path / "bode.txt")
    assert (tmp_path / "bode.png").read_bytes().startswith(b"\x89PNG")
    size, phase = bode(found.model, [curve]).axes
    frequency, magnitude = (np.asarray(part) for part in size.lines[1].get_data())
    away = np.abs(curve.frequency_hz - 20.0) > 4.0  # the averaged response is smeared where it is sharp
    drawn = np.interp(curve.frequency_hz[away], frequency, magnitude)
    assert np.median(np.abs(drawn / curve.magnitude[away] - 1.0)) < 0.1
    assert size.get_ylabel() == "magnitude (rad per N m)" and phase.get_ylabel() == "phase (°)"


def test_segments_that_follow_each_other_are_averaged_as_one(tmp_path):
    rng = np.random.default_rng(4)
    u, y = rng.standard_normal((2, 6000))
    channels = [Channel("u", "N m", "input", "a", RATE_HZ), Channel("y", "rad", "output", "a", RATE_HZ)]
    curves: list[ResponseCurve] = []
    for cuts in ((0, 6000), (0, 2500, 6000)):
        path = tmp_path / f"{len(cuts)}.h5"
        with LogWriter.create(path, channels, test="t", bench={"kind": "imported", "name": "n"}) as writer:
            for start, stop in zip(cuts[:-1], cuts[1:], strict=True):
                with writer.segment(f"from {start}", {}):
                    writer.append({"u": u[start:stop], "y": y[start:stop]})
        with read_run(path) as run:
            curves += curves_of_run(run)
    whole, cut = curves
    # pieces of 6000 samples, not of the 3500 of the longer segment: lines nearer to each other
    assert np.array_equal(whole.frequency_hz, cut.frequency_hz) and np.array_equal(whole.magnitude, cut.magnitude)
