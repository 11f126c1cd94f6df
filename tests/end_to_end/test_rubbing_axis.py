"""A bench nobody has described: import, identify and diagnose find the friction of a rigid axis in a loop."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.analysis.identification.rubbing_axis import FRICTION, RATE_HZ, play
from tests.end_to_end.linear_bench import moves
from tests.end_to_end.unknown_bench import diagnosed

Array = NDArray[np.float64]

FINE_HZ, STEPS, COUNT_M = 1000.0, 40, 1e-6
MASS, DAMPING, RUB, SLIP_M, PULL = 3.1, 4.2, 0.44, 3e-6, 0.07
"""The finer axis: in units of the drive (V), per m/s² and per m/s, what rubs, what it gives before, and always.

Numbers and seed were fixed before its record was diagnosed.
"""


def finely_played(seed: int) -> tuple[Array, Array]:
    """Return drive and counted reading (n,) of an axis whose friction is a spring that slips, under a loop."""
    rng = np.random.default_rng(seed)
    reference = moves(rng, 16_000, FINE_HZ) * 0.03
    x, v, f, last, u, y = 0.0, 0.0, 0.0, 0.0, np.empty(reference.size), np.empty(reference.size)
    dt = 1.0 / FINE_HZ / STEPS
    for k in range(reference.size):
        y[k] = COUNT_M * np.round(x / COUNT_M)
        u[k] = np.clip(60.0 * (40.0 * (reference[k] - y[k]) - (y[k] - last) * FINE_HZ), -10.0, 10.0)
        last = y[k]
        for _ in range(STEPS):
            f = min(max(f + RUB / SLIP_M * v * dt, -RUB), RUB)
            v += dt * (u[k] - DAMPING * v - f - PULL) / MASS
            x += dt * v
    return u, y


@pytest.mark.parametrize("friction", [FRICTION, 5.0 * FRICTION])
def test_friction_in_a_loop_is_named_and_explains_the_held_out_end(tmp_path, friction):
    """The stronger one is most of what the drive plays, and holds the axis between its moves."""
    found = diagnosed(tmp_path, *play(12.0, 3, friction), RATE_HZ)
    assert found["verdict"] == "named", found["sentence"]
    causes = {cause["effect"]: cause for cause in found["causes"]}
    assert "coulomb-friction" in causes and set(causes) <= {"coulomb-friction", "constant-torque"}
    torque = causes["coulomb-friction"]["parameters"]["torque"]["value"]
    assert abs(torque / friction - 1.0) < 0.02  # noise alone would allow 1e-4; the standstill is modelled differently
    assert found["gain"]["rms_after"] < 0.2 * found["gain"]["rms_before"]


@pytest.mark.slow
def test_a_friction_that_gives_by_a_few_counts_has_its_size(tmp_path):
    """Sharper than anything that is screened: from a start that gives too late, the size of the friction is wrong."""
    found = diagnosed(tmp_path, *finely_played(731), FINE_HZ)
    assert found["verdict"] == "named", found["sentence"]
    causes = {cause["effect"]: cause for cause in found["causes"]}
    assert "coulomb-friction" in causes and set(causes) <= {"coulomb-friction", "sensor-quantisation"}
    assert causes["coulomb-friction"]["parameters"]["torque"]["value"] == pytest.approx(RUB, rel=5e-3)
    assert found["gain"]["rms_after"] < 0.05 * found["gain"]["rms_before"]


def test_a_free_axis_that_only_something_pushes_is_consistent(tmp_path):
    """A torque that is always there is no cause where the model was fitted to it."""
    assert diagnosed(tmp_path, *play(12.0, 3, 0.0), RATE_HZ)["verdict"] == "consistent"
