"""Benches nobody has described: a spring that stiffens is named, a linear one is consistent."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

RATE_HZ = 500.0
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


def play(cubic_1_m2: float, seed: int):
    """Return drive and reading (n,) of one mode at 23 Hz, 4 % damped, by the classical Runge-Kutta rule."""
    rng = np.random.default_rng(seed)
    n, omega, ratio = 8000, 2.0 * np.pi * 23.0, 0.04
    # noise with the spectrum of a first-order filter, louder in its second half
    u = np.zeros(n)
    for k in range(1, n):
        u[k] = 0.7 * u[k - 1] + 0.03 * rng.standard_normal()
    u[n // 2 :] *= 1.6
    x, y, h = np.zeros(2), np.zeros(n), 1.0 / RATE_HZ / 6

    def slope(x, drive):
        return np.array([x[1], omega**2 * (drive - x[0] - cubic_1_m2 * x[0] ** 3) - 2.0 * ratio * omega * x[1]])

    for k in range(n):
        y[k] = x[0]
        for _ in range(6):
            k1 = slope(x, u[k])
            k2 = slope(x + 0.5 * h * k1, u[k])
            k3 = slope(x + 0.5 * h * k2, u[k])
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + slope(x + h * k3, u[k]))
    return u, y + 5e-4 * rng.standard_normal(n)


def diagnosed(tmp_path, cubic_1_m2: float, seed: int):
    u, y = play(cubic_1_m2, seed)
    np.savetxt(tmp_path / "data.csv", np.stack([u, y], axis=1), delimiter=",", header="u,y", comments="")
    (tmp_path / "map.toml").write_text(MAP.format(rate=RATE_HZ, split=3 * u.size // 4, stop=u.size))
    for arguments in (("import", "map.toml", "-o", "run.h5"), ("identify", "--log", "run.h5", "-o", "nominal.toml")):
        done = mccd(tmp_path, *arguments)
        assert done.returncode == 0, done.stderr
    return json.loads(mccd(tmp_path, "diagnose", "run.h5", "--model", "nominal.toml", "-o", "out", "--json").stdout)


def test_a_spring_that_stiffens_is_named(tmp_path):
    found = diagnosed(tmp_path, 1.2, 11)
    assert [cause["effect"] for cause in found["causes"]] == ["cubic-stiffness"], found["sentence"]
    stiffness = found["causes"][0]["parameters"]["stiffness"]["value"]  # the drive is in units of the spring's own
    assert stiffness == pytest.approx(1.2, rel=0.03)
    assert found["gain"]["rms_after"] < 0.3 * found["gain"]["rms_before"]


@pytest.mark.parametrize("seed", [21, 22, 23])
def test_a_linear_spring_is_consistent(tmp_path, seed):
    assert diagnosed(tmp_path, 0.0, seed)["verdict"] == "consistent"
