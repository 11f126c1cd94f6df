"""From two columns of numbers to a diagnosis, by the commands that the owner of an unknown bench would type."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np

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


def diagnosed(folder, u, y, rate_hz):
    """Return diagnosis.json of drive `u` and reading `y` (n,), its last quarter held out; nobody knows a model."""
    np.savetxt(folder / "data.csv", np.stack([u, y], axis=1), delimiter=",", header="u,y", comments="")
    (folder / "map.toml").write_text(MAP.format(rate=rate_hz, split=3 * u.size // 4, stop=u.size))
    for arguments in (("import", "map.toml", "-o", "run.h5"), ("identify", "--log", "run.h5", "-o", "nominal.toml")):
        done = mccd(folder, *arguments)
        assert done.returncode == 0, done.stderr
    return json.loads(mccd(folder, "diagnose", "run.h5", "--model", "nominal.toml", "-o", "out", "--json").stdout)
