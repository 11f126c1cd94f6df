"""A plant under a digital controller that answers within its sample: found as a loop, and identified without a bias.

The controller has proportional, integral and filtered derivative action; all that a reading holds of noise is in the
drive of the very sample, a few hundred times as large.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray

from analysis.identification.identify import identify_runs
from campaigns.importing import import_run
from campaigns.log import read_run
from sim_backend.model import Quantity

Array = NDArray[np.float64]

RATE_HZ, ROWS = 1000.0, 10_000
FREQUENCY_HZ, DAMPING, GAIN = 20.0, 0.03, 100.0
NOISES = {
    "white": (0.003, [1.0]),
    "drifting": (0.001, [1.0, -0.995]),
    "humming": (0.0015, [1.0, -1.6, 0.9]),
}

MAP = """
[log]
test = "a loop"
source = "data.csv"
sample_rate_hz = 1000.0
{period}
[channels.reference]
select = "r"
unit = "rad"
role = "reference"
[channels.drive]
select = "u"
unit = "N m"
role = "input"
dof = "x"
[channels.x]
select = "y"
unit = "rad"
role = "output"
dof = "x"
"""


def played(noise: str, seed: int, period: int) -> Array:
    """Return reference, drive and reading (n, 3); the reference repeats itself after `period` samples."""
    rng = np.random.default_rng(seed)
    omega = 2.0 * np.pi * FREQUENCY_HZ
    plant = (np.array([[0.0, 1.0], [-(omega**2), -2.0 * DAMPING * omega]]), np.array([[0.0], [GAIN]]))
    over, into, *_ = scipy.signal.cont2discrete((*plant, np.eye(2), np.zeros((2, 1))), 1.0 / RATE_HZ)
    size, colour = NOISES[noise]
    reference = 0.05 * scipy.signal.lfilter([0.05], [1.0, -0.95], rng.standard_normal(ROWS))
    reference = np.resize(reference[:period], ROWS)
    misread = size * scipy.signal.lfilter([1.0], colour, rng.standard_normal(ROWS))
    x, total, slope, last = np.zeros(2), 0.0, 0.0, 0.0
    out = np.empty((ROWS, 3))
    for k in range(ROWS):
        reading = x[0] + misread[k]
        error = reference[k] - reading
        total += 2000.0 * error / RATE_HZ
        slope, last = 0.8 * slope + 0.2 * RATE_HZ * (error - last), error
        drive = 100.0 * error + total + 1.2 * slope
        out[k] = reference[k], drive, reading
        x = over @ x + into[:, 0] * drive
    return out


@pytest.mark.parametrize(("noise", "period"), [*((noise, ROWS) for noise in NOISES), ("drifting", 1000)])
def test_its_numbers_are_right_within_what_they_say(tmp_path: Path, noise: str, period: int) -> None:
    np.savetxt(tmp_path / "data.csv", played(noise, 1, period), delimiter=",", header="r,u,y", comments="")
    (tmp_path / "map.toml").write_text(MAP.format(period=f"period = {period}" if period < ROWS else ""))
    import_run(tmp_path / "map.toml", tmp_path / "run.h5")
    with read_run(tmp_path / "run.h5") as run:
        found = identify_runs([run])
    assert "in a loop" in found.method
    (mode,) = found.model.modes
    true = (
        (mode.frequency_hz, FREQUENCY_HZ),
        (mode.decay_rate_1_s, 2.0 * np.pi * FREQUENCY_HZ * DAMPING),
        (mode.output["x"], GAIN),
    )
    for quantity, value in true:
        assert isinstance(quantity, Quantity) and quantity.std is not None
        assert abs(quantity.value - value) < 3.0 * quantity.std
        assert quantity.std < 0.1 * value
    assert not found.model.feedthrough and not found.model.delay_s
