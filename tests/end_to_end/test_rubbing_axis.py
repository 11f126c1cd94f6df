"""A bench nobody has described: import, identify and diagnose find the friction of a rigid axis in a loop."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np

from tests.analysis.rubbing_axis import FRICTION, RATE_HZ, play

MAP = """
[log]
test = "free-run"
source = "data.csv"
sample_rate_hz = {rate}
[channels.drive]
select = "u"
unit = "V"
role = "input"
dof = "x"
[channels.position]
select = "y"
unit = "m"
role = "output"
dof = "x"
[segments]
"train" = [0, {split}]
"held-out end" = [{split}, {stop}]
"""


def mccd(folder, *arguments):
    return subprocess.run(
        [sys.executable, "-m", "mccdcli", *arguments], cwd=folder, capture_output=True, text=True, timeout=300
    )


def test_friction_in_a_loop_is_named_and_explains_the_held_out_end(tmp_path):
    u, y = play(12.0, 3)
    np.savetxt(tmp_path / "data.csv", np.stack([u, y], axis=1), delimiter=",", header="u,y", comments="")
    split = 3 * u.size // 4
    (tmp_path / "map.toml").write_text(MAP.format(rate=RATE_HZ, split=split, stop=u.size))
    for arguments in (
        ("import", "map.toml", "-o", "run.h5"),
        ("identify", "--log", "run.h5", "-o", "nominal.toml"),
    ):
        done = mccd(tmp_path, *arguments)
        assert done.returncode == 0, done.stderr
    done = mccd(tmp_path, "diagnose", "run.h5", "--model", "nominal.toml", "-o", "out", "--json")
    found = json.loads(done.stdout)
    assert found["verdict"] == "named", found["sentence"]
    causes = {cause["effect"]: cause for cause in found["causes"]}
    assert "coulomb-friction" in causes and set(causes) <= {"coulomb-friction", "constant-torque"}
    torque = causes["coulomb-friction"]["parameters"]["torque"]["value"]
    assert abs(torque / FRICTION - 1.0) < 0.02  # noise alone would allow 1e-4; the standstill is modelled differently
    assert found["gain"]["rms_after"] < 0.2 * found["gain"]["rms_before"]
