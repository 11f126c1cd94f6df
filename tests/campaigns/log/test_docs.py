"""The readers that docs/log-format.md shows do read a log."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from campaigns.log import Channel, LogWriter

PAGE = Path(__file__).parents[3] / "docs" / "log-format.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture
def in_log_folder(tmp_path, monkeypatch):
    with LogWriter.create(
        tmp_path / "RUN.h5", [Channel("theta_x", "rad", "output", "theta_x", 100.0, 0.5)], test="t", bench={}
    ) as log:
        with log.segment("sweep up", {"frequency_hz": 5.0}):
            log.append({"theta_x": np.arange(7.0)})
    monkeypatch.chdir(tmp_path)


def run_block(index: int, names: dict[str, Any] | None = None) -> dict[str, Any]:
    names = names or {}
    exec(compile(BLOCKS[index], f"{PAGE.name}, block {index}", "exec"), names)
    return names


def test_plain_h5py(in_log_folder, capsys):
    names = run_block(0)
    np.testing.assert_array_equal(names["values"], np.arange(7.0))
    assert names["rate"] == 100.0
    assert capsys.readouterr().out == "sweep up 0 7 {'frequency_hz': 5.0}\n"


def test_pandas(in_log_folder):
    names = run_block(1)
    assert names["units"] == {"theta_x": "rad"}
    np.testing.assert_array_equal(names["frame"]["theta_x"], np.arange(7.0))
    np.testing.assert_allclose(names["frame"].index, 0.5 + np.arange(7) / 100.0, rtol=1e-15)


def test_xarray(in_log_folder):
    pytest.importorskip("xarray")
    names = run_block(2, run_block(1))
    np.testing.assert_array_equal(names["dataset"]["theta_x"], np.arange(7.0))
    assert names["dataset"]["theta_x"].attrs == {"units": "rad"}


def test_our_reader(in_log_folder):
    names = run_block(3)
    np.testing.assert_array_equal(names["angle"], np.arange(7.0))
    assert names["first"] == 0
