"""The held-out error that `mccd identify` prints is the one that `mccd diagnose` finds of the same model."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from tests.end_to_end.unknown_bench import diagnosis, imported, mccd, write_data, write_map

ROWS, RATE_HZ, NOISE = 3000, 1000.0, 0.02


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
    # identification fits the start of the held-out rows, two numbers of a thousand; the diagnosis simulates on
    assert found["gain"]["rms_before"] == pytest.approx(held_out["total"], rel=5e-3)
    assert held_out["total"] == pytest.approx(NOISE, rel=4.0 / np.sqrt(2.0 * (ROWS - 2000)))
