"""Other identification beside ours: peers on plants that they can have, and the page of a whole run."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import peers_identify
from benchmarks.peers_models import StateSpace, arx_models, free_run_error, n4sid_models
from benchmarks.peers_plants import KINDS, Kind, drawn, simulated, state_space

QUIET = Kind("a quiet mode", 1000.0, rows=3000, noise=1e-6, late=(3.0, 5.0))


def halves(kind: Kind) -> tuple[list[tuple[np.ndarray, np.ndarray]], tuple[np.ndarray, np.ndarray], float]:
    record = drawn(kind, 3)
    u, y, cut = record.inputs, record.outputs, record.fitted
    return [(u[:cut], y[:cut])], (u[cut:], y[cut:]), float(record.floor[0])


def test_an_arx_of_a_quiet_plant_finds_order_and_delay_and_leaves_the_noise() -> None:
    fitted, held, floor = halves(QUIET)
    for _, model in arx_models(fitted):
        assert free_run_error(model, *held)[0] < 1.5 * floor


def test_n4sid_of_a_quiet_plant_leaves_little() -> None:
    pytest.importorskip("sippy_unipi", reason="sippy_unipi is not installed: it is in the extra `peers-identify`")
    fitted, held, _ = halves(QUIET)
    ((_, model),) = n4sid_models(fitted)
    assert free_run_error(model, *held)[0] < 0.01


def test_a_model_that_runs_away_has_an_infinite_error() -> None:
    one = np.ones((1, 1))
    model = StateSpace(3.0 * one, one, one, 0.0 * one, np.zeros(1), "")
    u = np.random.default_rng(1).standard_normal((2000, 1))
    assert free_run_error(model, u, u)[0] == np.inf


def test_a_part_of_a_sample_of_delay_is_that_of_a_simulation_on_finer_steps() -> None:
    a, b, c, d = state_space(KINDS[0], np.random.default_rng(2))
    u, rate_hz, finer = np.random.default_rng(3).standard_normal((300, 1)), 1000.0, 4
    coarse = simulated(a, b, c, d, u, np.array([2.25]), rate_hz)
    fine = simulated(a, b, c, d, np.repeat(u, finer, axis=0), np.array([9.0]), finer * rate_hz)
    np.testing.assert_allclose(coarse, fine[::finer], atol=1e-9 * np.abs(coarse).max())


def test_kinds_have_names_of_their_own_and_are_twenty_at_least() -> None:
    assert len({kind.name for kind in KINDS}) == len(KINDS) >= 20


@pytest.mark.slow
def test_a_run_writes_a_page_and_names_who_is_absent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(
        peers_identify, "PEERS", {"ARX": ("numpy", arx_models), "nobody": ("a_package_that_nobody_has", arx_models)}
    )
    words = ["--seed", "3", "--only", "one slow mode", "--out", str(tmp_path)]
    assert peers_identify.main(words) == 0
    assert "nobody is not installed and left out" in capsys.readouterr().err
    (written,) = tmp_path.glob("peers-identify-*.json")
    result = json.loads(written.read_text(encoding="utf-8"))
    (case,) = result["cases"]
    assert result["absent"] == ["nobody"]
    assert set(case["found"]) == {"mccd identify", "ARX by AIC", "ARX by free run"}
    assert case["found"]["mccd identify"]["error"] < 1.05 * case["floor"]
    assert written.with_suffix(".md").read_text(encoding="utf-8") == peers_identify.page(result)
