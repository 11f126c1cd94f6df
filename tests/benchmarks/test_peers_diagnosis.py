"""Sparse regression beside the diagnosis: each method on a case that it can solve, and the page of a whole run."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from analysis.challenge.make import Counts, make_challenge
from benchmarks import peers_diagnosis
from benchmarks.peers_diagnosis import Data, main
from sim_backend.linear import ModalModel

RATE_HZ = 1000.0
OMEGA, SIGMA = 2.0 * np.pi * 20.0, 6.0


def peer(module: str) -> None:
    pytest.importorskip(module, reason=f"{module} is not installed: it is in the extra `peers-diagnosis`")


def played(cubic: float) -> Data:
    """One mode with a cubic spring, by the classical Runge-Kutta rule, 8 steps a sample; the last quarter held out."""
    rng, n, h = np.random.default_rng(3), 8000, 1.0 / RATE_HZ / 8
    u = np.repeat(rng.standard_normal(n // 8), 8)
    state, y = np.zeros(2), np.empty(n)

    def slope(x: np.ndarray, drive: float) -> np.ndarray:
        return np.array([x[1], OMEGA**2 * (drive - x[0] - cubic * x[0] ** 3) - 2.0 * SIGMA * x[1]])

    for k in range(n):
        y[k] = state[0]
        for _ in range(8):
            k1 = slope(state, u[k])
            k2 = slope(state + 0.5 * h * k1, u[k])
            k3 = slope(state + 0.5 * h * k2, u[k])
            state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + slope(state + h * k3, u[k]))
    model = ModalModel(
        omega_rad_s=np.array([OMEGA]),
        sigma_1_s=np.array([SIGMA]),
        b=np.array([[OMEGA**2]]),
        b_direct=np.zeros((1, 1)),
        c=np.ones((1, 1)),
        c_rate=np.zeros((1, 1)),
        d=np.zeros((1, 1)),
        delay_s=np.zeros(1),
    )
    return Data(u, y + 1e-4 * rng.standard_normal(n), np.arange(n) < 3 * n // 4, model, RATE_HZ)


def test_the_nominal_model_predicts_a_linear_bench_to_its_noise() -> None:
    data = played(0.0)
    found = peers_diagnosis.nominal(data)
    assert found.error == pytest.approx(1e-4 / np.std(data.y[~data.fitted]), rel=0.1)


def test_sindy_finds_a_cubic_spring_and_halves_the_error() -> None:
    peer("pysindy")
    data = played(0.3)
    found = peers_diagnosis.sindy(data)
    assert "cubic-stiffness" in found.causes
    assert found.error < 0.5 * peers_diagnosis.nominal(data).error


def test_frols_predicts_a_linear_bench() -> None:
    peer("sysidentpy")
    found = peers_diagnosis.frols(played(0.0))
    assert found.terms > 0
    assert found.error < 0.1  # of the motion; without a model it is 1


def test_a_run_writes_a_page_and_names_who_is_absent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    methods = {
        "nominal model": ("numpy", peers_diagnosis.nominal),
        "nobody": ("a_package_that_nobody_has", peers_diagnosis.nominal),
    }
    monkeypatch.setattr(peers_diagnosis, "METHODS", methods)
    make_challenge(tmp_path / "blind", Counts(one=1, none=2), seed=7, families=("cubic-stiffness",), shape="short")
    assert main([str(tmp_path / "blind"), "--cases", "2", "--out", str(tmp_path), "--made-by", "mccd challenge …"]) == 0
    assert "nobody is not installed and left out" in capsys.readouterr().err
    (written,) = tmp_path.glob("peers-diagnosis-*.json")
    result = json.loads(written.read_text(encoding="utf-8"))
    assert result["absent"] == ["nobody"] and result["commands"][0] == "mccd challenge …"
    assert 1 <= len(result["cases"]) <= 2
    assert all(row["ours"] is None and set(row["found"]) == {"nominal model"} for row in result["cases"])
    text = written.with_suffix(".md").read_text(encoding="utf-8")
    assert text.count("| nominal model |") == len(result["cases"])
    assert text == peers_diagnosis.page(result)
