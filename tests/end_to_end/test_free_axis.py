"""An axis that nothing holds, in a loop: what its encoder, its rounding or its drive does wrong is found in its drift.

The bench is integrated by formulas of its own; numbers and seeds were fixed before any of its records was diagnosed.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.end_to_end.linear_bench import moves
from tests.end_to_end.unknown_bench import diagnosed

Array = NDArray[np.float64]

RATE_HZ, ROWS = 800.0, 10_000
INERTIA, DRAG = 1.9e-3, 8.4e-3
NOISE = 3e-5
PITCH, ERROR, COUNT, WIDTH = 0.12, 1.5e-3, 1.25e-3, 4e-3

pytestmark = pytest.mark.slow


def play(seed: int, read: Callable[[float], float], drive: Callable[[float], float]) -> tuple[Array, Array]:
    """Return drive and reading (n,) under a loop that answers within its sample; the axis gets what `drive` makes."""
    rng = np.random.default_rng(seed)
    reference = moves(rng, ROWS, RATE_HZ)
    x, v, before, u, y = 0.0, 0.0, 0.0, np.empty(ROWS), np.empty(ROWS)
    decay, dt = DRAG / INERTIA, 1.0 / RATE_HZ
    fade = np.exp(-decay * dt)
    for k in range(ROWS):
        y[k] = read(x + NOISE * rng.standard_normal())
        error = reference[k] - y[k]
        u[k] = 0.9 * error + 0.014 * (error - before) * RATE_HZ
        before = error
        # exact over one sample of a held torque
        far = drive(u[k]) / DRAG
        x, v = x + far * dt + (v - far) * (1.0 - fade) / decay, far + (v - far) * fade
    return u, y


def causes(found: dict[str, Any]) -> dict[str, dict[str, float]]:
    return {c["effect"]: {k: e["value"] for k, e in c["parameters"].items()} for c in found["causes"]}


def test_an_encoder_that_errs_within_its_pitch_is_named(tmp_path: Path) -> None:
    u, y = play(611, lambda x: x + ERROR * np.sin(2.0 * np.pi * x / PITCH), lambda torque: torque)
    found = diagnosed(tmp_path, u, y, RATE_HZ)
    assert found["verdict"] == "named", found["sentence"]
    error = causes(found)
    assert set(error) == {"periodic-sensor-error"}
    assert error["periodic-sensor-error"]["period"] == pytest.approx(PITCH, rel=1e-3)
    size = np.hypot(error["periodic-sensor-error"]["cosine"], error["periodic-sensor-error"]["sine"])
    assert size == pytest.approx(ERROR, rel=0.02)
    assert found["gain"]["rms_after"] < 0.2 * found["gain"]["rms_before"]


def test_counts_are_named_as_such_and_not_as_what_repeats_with_them(tmp_path: Path) -> None:
    u, y = play(612, lambda x: COUNT * np.round(x / COUNT), lambda torque: torque)
    found = diagnosed(tmp_path, u, y, RATE_HZ)
    assert found["verdict"] == "named", found["sentence"]
    assert set(causes(found)) == {"sensor-quantisation"}
    assert causes(found)["sensor-quantisation"]["step_size"] == pytest.approx(COUNT, rel=1e-6)


def test_a_drive_that_does_nothing_near_zero_is_named(tmp_path: Path) -> None:
    u, y = play(613, lambda x: x, lambda torque: np.sign(torque) * max(abs(torque) - WIDTH, 0.0))
    found = diagnosed(tmp_path, u, y, RATE_HZ)
    assert found["verdict"] == "named", found["sentence"]
    assert set(causes(found)) == {"dead-zone"}
    assert causes(found)["dead-zone"]["width"] == pytest.approx(WIDTH, rel=0.01)
    assert found["gain"]["rms_after"] < 0.1 * found["gain"]["rms_before"]


def test_an_axis_that_does_nothing_wrong_is_consistent(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, *play(614, lambda x: x, lambda torque: torque), RATE_HZ)
    assert (found["verdict"], causes(found)) == ("consistent", {}), found["sentence"]
