"""A folder with data, and a map that is written beside them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.forked import forked
from campaigns.importing import ImportReport, import_run, isolated

Import = Callable[[str], ImportReport]

HEAD = """
[log]
test = "free-run"
source = "{source}"
sample_rate_hz = 10000.0
"""
CHANNELS = """
[channels.torque]
select = "tx"
unit = "mN m"
role = "input"
dof = "theta_x"
[channels.angle]
select = "ax"
unit = "mrad"
role = "output"
dof = "theta_x"
"""


@pytest.fixture(autouse=True)
def readers(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let readers be copies of this process, which has imported what they need; `started_readers` are as users' are."""
    if "started_readers" not in request.fixturenames:
        monkeypatch.setattr(isolated, "start_python", forked)


@pytest.fixture
def started_readers() -> None:
    """Let readers be processes of their own, from their first import on."""


@pytest.fixture
def data() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(11)
    return {"tx": rng.normal(size=500), "ax": rng.normal(size=500)}


@pytest.fixture
def run_map(tmp_path: Path) -> Import:
    """Write a map into the folder and import it to `out.h5` there."""

    def run(text: str) -> ImportReport:
        (tmp_path / "map.toml").write_text(text, encoding="utf-8")
        return import_run(tmp_path / "map.toml", tmp_path / "out.h5")

    return run


@pytest.fixture
def plain() -> Callable[[str], str]:
    """Return the map of two channels, torque in mN m from `tx` and angle in mrad from `ax`, for a source."""
    return lambda source: HEAD.format(source=source) + CHANNELS
