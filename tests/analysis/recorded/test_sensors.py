from typing import Any

import numpy as np
import pytest

from analysis.recorded.sensors import endstops_of, theodolite_of
from sim_backend.errors import DataError

HEADS = [(f"head_s{i}", "m", "aux", f"s{i}") for i in (1, 2, 3)]
ANGLES = [
    ("theta_x", "rad", "output", "theta_x"),
    ("theta_y", "rad", "output", "theta_y"),
    ("theodolite_theta_x", "rad", "aux", "theta_x"),
    ("theodolite_theta_y", "rad", "aux", "theta_y"),
]


def test_only_the_holds_against_the_stops_count(write_log):
    rng = np.random.default_rng(1)
    parts = []
    for signs, sigma in (("+++", 2e-9), ("---", 8e-9)):
        heads = {name: 1e-4 + sigma * rng.normal(size=4000) for name, *_ in HEADS}
        parts.append((f"pull {signs}", {"phase": "pull", "signs": signs}, {n: rng.normal(size=100) for n in heads}))
        parts.append((f"hold {signs}", {"phase": "hold", "signs": signs}, heads))
    found = endstops_of(write_log("endstops", HEADS, parts))
    assert found.positions == ("+++", "---")
    assert found.sensors == ("head_s1", "head_s2", "head_s3")
    expected = 3.0 * np.array([[2e-9] * 3, [8e-9] * 3])
    # six values known to 1/sqrt(8000) = 1.1 %: within four of it
    np.testing.assert_allclose(found.noise.three_sigma_m, expected, rtol=0.045)


def theodolite_parts(gain):
    parts: list[tuple[str, dict[str, Any], dict[str, np.ndarray]]] = []
    for i, (x, y) in enumerate([(-8e-3, 0.0), (0.0, 4e-3), (2e-3, -8e-3), (8e-3, 1e-3)]):
        n = 50
        held = {"theta_x": np.full(n, x), "theta_y": np.full(n, y)}
        held |= {"theodolite_theta_x": np.full(n, gain * x), "theodolite_theta_y": np.full(n, y)}
        parts.append((f"move {i}", {"phase": "move"}, {k: np.full(5, 1.0) for k in held}))
        parts.append((f"hold {i}", {"phase": "hold", "theta_x_rad": x, "theta_y_rad": y}, held))
    return parts


def test_gains_against_the_recorded_instrument_and_against_readings_given(write_log):
    run = write_log("theodolite", ANGLES, theodolite_parts(1.005))
    found = theodolite_of(run)
    np.testing.assert_allclose(found.calibration.gain_correction, [0.005, 0.0], atol=1e-12)
    given = theodolite_of(run, 1.01 * found.sensor_rad)
    np.testing.assert_allclose(given.calibration.gain_correction, 0.01, atol=1e-12)


def test_what_is_missing_is_said(write_log):
    bare = [
        (label, s, {k: v for k, v in values.items() if "theodolite" not in k})
        for label, s, values in theodolite_parts(1.0)
    ]
    run = write_log("theodolite", ANGLES[:2], bare)
    with pytest.raises(DataError, match="records no theodolite"):
        theodolite_of(run)
    with pytest.raises(DataError, match="one reading per position"):
        theodolite_of(run, np.zeros((3, 2)))
    with pytest.raises(DataError, match="no end-stop positions"):
        endstops_of(run)
