"""Two drives that lag behind themselves, two sensors beside neither: the gross cause is named, at both drives.

So is what happens in the modes beside it, where neither a drive nor a sensor stands.

The bench is simulated here by a scheme of its own: midpoint steps, twenty to a sample, with plays of Prandtl and
Ishlinskii in the drives. The linear model is fitted to its records.
"""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np
import pytest
from numba import njit

from tests.end_to_end.unknown_bench import diagnosis, identified, imported

RATE_HZ, PERIOD, FINER = 1000.0, 2048, 20
LEVELS_V = (0.5, 1.0, 2.0)
SOFTENING = 0.006  # of a mode's stiffness per unit of its rms
MEMORY_S = 0.4
OMEGA = 2.0 * np.pi * np.array([61.0, 88.0])
SHAPES = np.array([[0.8, 0.6], [-0.5, 0.9]])  # of each mode at the two drives
AT_DRIVE = np.ascontiguousarray(SHAPES.T)
SEEN = np.array([[1.0, 0.35], [-0.4, 1.2]]) * 1e-6  # of each mode at the two sensors
MAP = """
[log]
test = "two drives"
sample_rate_hz = 1000.0
axes = ["sample", "realisation", "period"]
"""
CHANNEL = """
[channels.{name}_{i}]
source = "{source}"
select = "{source}[:, {j}]"
unit = "{unit}"
role = "{role}"
dof = "{dof}_{i}"
"""
PART = """
[[parts]]
label = "{label}"
sources = {{ u = "u_{file}.npy", y = "y_{file}.npy" }}
settings = {{ level_v = {level} }}
"""


@njit
def played(u, hysteresis, softening, y):
    """Fill `y` (n, 2) with what the sensors see of drives `u` (n, 2), starting at rest.

    A mode loses the part `softening` of its stiffness per unit of its rms, which it remembers for MEMORY_S.
    """
    q, v, h = np.zeros(2), np.zeros(2), 1.0 / RATE_HZ / FINER
    reaches, weights = np.array([0.3, 0.9, 2.0, 4.0]), np.array([0.10, 0.07, 0.05, 0.05])
    slid, square, since = np.zeros((2, 4)), np.zeros(2), 0.0
    for k in range(u.shape[0]):
        y[k] = SEEN @ q
        for _ in range(FINER):
            middle, rate = q + 0.5 * h * v, v
            since += h
            square += h / min(since, MEMORY_S) * (middle**2 - square)
            force = u[k].copy()
            for j in range(2):
                x = AT_DRIVE[j] @ middle
                for i in range(4):
                    slid[j, i] = min(max(slid[j, i], x - reaches[i]), x + reaches[i])
                    force[j] -= hysteresis * weights[i] * (x - slid[j, i])
            for m in range(2):
                held = 1.0 - softening * np.sqrt(square[m])
                a = OMEGA[m] ** 2 * (SHAPES[m] @ force - held * middle[m]) - 2.0 * 0.02 * OMEGA[m] * rate[m]
                q[m], v[m] = q[m] + h * (v[m] + 0.5 * h * a), v[m] + h * a


def recorded(folder, hysteresis: float, softening: float = 0.0) -> dict[str, Any]:
    """Write four multisines per level, the last of them held out, and return their diagnosis."""
    rng = np.random.default_rng(5)
    lines = np.arange(4, 400)
    text = MAP + "".join(
        CHANNEL.format(name=name, source=source, i=i, j=i - 1, unit=unit, role=role, dof=dof)
        for name, source, unit, role, dof in (
            ("drive", "u", "V", "input", "piezo"),
            ("gap", "y", "m", "output", "point"),
        )
        for i in (1, 2)
    )
    for level in LEVELS_V:
        for label, count in (("", 3), ("held-out ", 1)):
            spectrum = np.zeros((PERIOD // 2 + 1, 2, count), complex)
            spectrum[lines] = np.exp(2j * np.pi * rng.random((lines.size, 2, count)))
            u = np.fft.irfft(spectrum, PERIOD, axis=0)
            u = np.repeat((u * level / u.std())[..., None], 2, axis=3)
            y = np.zeros_like(u)
            for r in range(count):
                whole = np.concatenate([u[:, :, r, 0]] * 4)
                out = np.zeros_like(whole)
                played(np.ascontiguousarray(whole), hysteresis, softening, out)
                y[:, :, r, :] = out[2 * PERIOD :].reshape(2, PERIOD, 2).transpose(1, 2, 0)
            y += 1e-9 * rng.standard_normal(y.shape)
            name = f"{label.strip()}{level:g}"
            np.save(folder / f"u_{name}.npy", u)
            np.save(folder / f"y_{name}.npy", y)
            text += PART.format(label=f"{label}{level:g} V", file=name, level=level)
    (folder / "map.toml").write_text(text)
    imported(folder)
    identified(folder, "--modes", "2", "--equal-weights")
    return diagnosis(folder, "--page")  # one of a bench with several axes


def test_hysteresis_at_both_drives_is_named_and_pays(tmp_path):
    found = recorded(tmp_path, hysteresis=1.0)
    assert found["verdict"] == "named", found["sentence"]
    assert {(c["effect"], c["where"]) for c in found["causes"]} == {
        ("hysteresis", "piezo_1"),
        ("hysteresis", "piezo_2"),
    }
    assert found["gain"]["rms_after"] < 0.5 * found["gain"]["rms_before"]
    extended = tomllib.loads((tmp_path / "out" / "extended.toml").read_text())
    assert set(extended["coordinates"]) == {"piezo_1", "piezo_2"}


def lost_per_deflection(folder, found: dict[str, Any]) -> list[float]:
    """Return by what part of its stiffness each mode softens per unit of what it adds to the outputs."""
    model = tomllib.loads((folder / "out" / "extended.toml").read_text())
    levels = {e["where"]: e["parameters"]["level"] for e in model["effects"] if e["effect"] == "slow-softening"}
    lost = {c["where"]: c["parameters"]["softening"]["value"] for c in found["causes"] if c["where"] in levels}
    return [lost[where] / levels[where]["value"] for where in ("mode 1", "mode 2")]


def test_slow_softening_in_the_modes_is_named_beside_hysteresis_at_the_drives(tmp_path):
    found = recorded(tmp_path, hysteresis=0.5, softening=SOFTENING)
    assert found["verdict"] == "named", found["sentence"]
    causes = {(c["effect"], c["where"]): c for c in found["causes"]}
    assert set(causes) == {
        ("hysteresis", "piezo_1"),
        ("hysteresis", "piezo_2"),
        ("slow-softening", "mode 1"),
        ("slow-softening", "mode 2"),
    }
    assert lost_per_deflection(tmp_path, found) == pytest.approx(SOFTENING / np.linalg.norm(SEEN, axis=0), rel=0.15)
    assert found["gain"]["rms_after"] < 0.2 * found["gain"]["rms_before"]


def test_slow_softening_alone_is_no_hysteresis(tmp_path):
    found = recorded(tmp_path, hysteresis=0.0, softening=SOFTENING)
    assert found["verdict"] == "named", found["sentence"]
    assert {(c["effect"], c["where"]) for c in found["causes"]} == {
        ("slow-softening", "mode 1"),
        ("slow-softening", "mode 2"),
    }
    assert lost_per_deflection(tmp_path, found) == pytest.approx(SOFTENING / np.linalg.norm(SEEN, axis=0), rel=0.15)
    assert [c["parameters"]["memory"]["value"] for c in found["causes"]] == pytest.approx([MEMORY_S] * 2, rel=0.1)
