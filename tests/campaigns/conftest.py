"""What the tests of plans, runs and campaigns share."""

from __future__ import annotations

from pathlib import Path

import pytest

from sim_backend.model import dump_model
from sim_backend.simbench import SimBench
from tests.small_bench import NOISE, bench_model


@pytest.fixture
def bench() -> SimBench:
    """Return the small bench with sensor noise."""
    return SimBench(bench_model(NOISE), 1)


@pytest.fixture
def design_path(tmp_path: Path) -> str:
    """Return the path of a design model that knows the bench's modes."""
    path = tmp_path / "design.toml"
    path.write_text(dump_model(bench_model(hardware=False)), encoding="utf-8")
    return str(path)
