"""Benches nobody has described: a spring that stiffens is named, a linear one is consistent."""

from __future__ import annotations

import numpy as np
import pytest

from tests.end_to_end.unknown_bench import Array, diagnosed

RATE_HZ = 500.0


def play(cubic_1_m2: float, seed: int) -> tuple[Array, Array]:
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


def test_a_spring_that_stiffens_is_named(tmp_path):
    found = diagnosed(tmp_path, *play(1.2, 11), RATE_HZ)
    assert [cause["effect"] for cause in found["causes"]] == ["cubic-stiffness"], found["sentence"]
    stiffness = found["causes"][0]["parameters"]["stiffness"]["value"]  # the drive is in units of the spring's own
    assert stiffness == pytest.approx(1.2, rel=0.03)
    assert found["gain"]["rms_after"] < 0.3 * found["gain"]["rms_before"]


@pytest.mark.parametrize("seed", [21, 22, 23])
def test_a_linear_spring_is_consistent(tmp_path, seed):
    assert diagnosed(tmp_path, *play(0.0, seed), RATE_HZ)["verdict"] == "consistent"
