"""A bench nobody has described: import, identify and diagnose find the friction of a rigid axis in a loop."""

from __future__ import annotations

import pytest

from tests.analysis.identification.rubbing_axis import FRICTION, RATE_HZ, play
from tests.end_to_end.unknown_bench import diagnosed


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


def test_a_free_axis_that_only_something_pushes_is_consistent(tmp_path):
    """A torque that is always there is no cause where the model was fitted to it."""
    assert diagnosed(tmp_path, *play(12.0, 3, 0.0), RATE_HZ)["verdict"] == "consistent"
