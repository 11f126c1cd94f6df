"""The held-out error that `mccd identify` prints is the one that `mccd diagnose` finds of the same model."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.signal import lfilter

from tests.end_to_end.linear_bench import oscillator, played
from tests.end_to_end.unknown_bench import diagnosis, imported, mccd, write_data, write_map

ROWS, RATE_HZ, NOISE = 3000, 1000.0, 0.02
SLOW_ROWS, SLOW_RATE_HZ, UNRECORDED = 4000, 100.0, 0.1


def test_identify_and_diagnose_agree_on_the_held_out_error(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    u = rng.standard_normal(ROWS)
    clean = lfilter([0.0, 0.5, 0.3], [1.0, -1.7, 0.95], u)
    write_data(tmp_path, u, clean + NOISE * clean.std() * rng.standard_normal(ROWS))
    write_map(tmp_path, RATE_HZ, [("train", 2000), ("held-out end", ROWS - 2000)])
    imported(tmp_path)
    done = mccd(tmp_path, "identify", "--log", "run.h5", "-o", "nominal.toml", "--json")
    assert done.returncode == 0, done.stderr
    (held_out,) = json.loads(done.stdout)["identification"]["held_out"]
    found = diagnosis(tmp_path)
    assert found["verdict"] == "consistent"
    # both fit the start of the held-out rows, two numbers of a thousand; the diagnosis counts them off
    assert found["gain"]["rms_before"] == pytest.approx(held_out["total"], rel=5e-3)
    assert held_out["total"] == pytest.approx(NOISE, rel=4.0 / np.sqrt(2.0 * (ROWS - 2000)))


def test_they_agree_where_a_slow_mode_swings_into_the_held_out_rows(tmp_path: Path) -> None:
    rng = np.random.default_rng(9)
    # a mode that rings for 35 s, driven by what nobody records as well: where it is after 20 s no model foretells
    a = block_diag(oscillator(1.5, 0.003), oscillator(12.0, 0.01))
    b, c = np.array([[0.0], [1.0], [0.0], [8.0]]), np.array([[1.0, 0.0, 8.0, 0.0]])
    u = rng.standard_normal((SLOW_ROWS, 1))
    y = played(a, b, c, u + UNRECORDED * rng.standard_normal(u.shape), SLOW_RATE_HZ)[:, 0]
    write_data(tmp_path, u[:, 0], y + NOISE * y.std() * rng.standard_normal(SLOW_ROWS))
    write_map(tmp_path, SLOW_RATE_HZ, [("train", 2000), ("held-out first", 1000), ("held-out last", 1000)])
    imported(tmp_path)
    done = mccd(tmp_path, "identify", "--log", "run.h5", "-o", "nominal.toml", "--json")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)["identification"]["held_out"]
    found = diagnosis(tmp_path)["segments"]
    assert [one["segment"].split("#")[1] for one in found] == [one["segment"] for one in told]
    assert [one["rms_before"] for one in found] == pytest.approx([one["total"] for one in told], rel=0.05)
