"""Readings line by line, each name at times of its own, become channels on one clock."""

from __future__ import annotations

import numpy as np
import pytest

from campaigns.log import read_run
from sim_backend.errors import ConfigError, DataError

MAP = """
[log]
test = "archive"
source = "a.csv"
sample_rate_hz = 20.0
resample = "linear"
archive = {{ time = "stamp", name = "pv", value = "val" }}
{more}
[channels.pump]
select = "PUMP:U"
unit = "V"
role = "input"
dof = "x"
[channels.level]
select = "TANK:L"
unit = "mm"
role = "output"
dof = "x"
"""


def lines(rng: np.random.Generator) -> list[str]:
    pump_s, level_s = np.sort(rng.uniform(0.0, 30.0, 400)), np.sort(rng.uniform(0.5, 29.0, 700))
    rows = [(t, "PUMP:U", repr(float(2.0 * t))) for t in pump_s]
    rows += [(t, "TANK:L", repr(float(100.0 - t))) for t in level_s]
    rows += [(t, "DOOR", "closed") for t in (3.0, 17.0)]
    return [f"{t!r};{name};{value}" for t, name, value in sorted((float(t), n, v) for t, n, v in rows)]


def test_readings_are_brought_to_one_clock(tmp_path, run_map):
    (tmp_path / "a.csv").write_text("stamp;pv;val\n" + "\n".join(lines(np.random.default_rng(4))) + "\n")
    made = run_map(MAP.format(more=""))
    assert made.sample_rate_hz == 20.0 and any("700 readings" in remark for remark in made.remarks)
    with read_run(tmp_path / "out.h5") as run:
        at_s = run.time_s("pump")
        np.testing.assert_allclose(run.read("pump"), 2.0 * at_s, rtol=1e-9)
        np.testing.assert_allclose(run.read("level"), (100.0 - at_s) * 1e-3, rtol=1e-9)


def test_what_an_archive_lacks_is_said(tmp_path, run_map):
    rows = lines(np.random.default_rng(4))
    (tmp_path / "a.csv").write_text("stamp;pv;val\n" + "\n".join(rows) + "\n")
    with pytest.raises(DataError, match="0 reading.* of 'TANK:X'.*PUMP:U"):
        run_map(MAP.format(more="").replace("TANK:L", "TANK:X"))
    with pytest.raises(DataError, match="the reading of 'DOOR' .* is 'closed'"):
        run_map(MAP.format(more="").replace("TANK:L", "DOOR"))
    with pytest.raises(ConfigError, match="say sample_rate_hz and resample"):
        run_map(MAP.format(more="").replace('resample = "linear"', ""))
    with pytest.raises(DataError, match="no column 'value'"):
        run_map(MAP.format(more="").replace('"val"', '"value"'))


def test_names_that_look_like_numbers_stay_apart(tmp_path, run_map):
    names = {"1.1": 1, "1.10": -1, "001": 2}
    rows = [f"{k * 0.1!r};{name};{factor * k}" for k in range(40) for name, factor in names.items()]
    (tmp_path / "a.csv").write_text("stamp;pv;val\n" + "\n".join(rows) + "\n")
    run_map(MAP.format(more="").replace("PUMP:U", "1.10").replace("TANK:L", "001"))
    with read_run(tmp_path / "out.h5") as run:
        at_s = run.time_s("pump")
        np.testing.assert_allclose(run.read("pump"), -10.0 * at_s, atol=1e-9)
        np.testing.assert_allclose(run.read("level"), 20e-3 * at_s, atol=1e-9)


def test_decimal_commas_in_an_archive(tmp_path, run_map):
    rows = [f"{k};{name};{k},5" for k in range(40) for name in ("PUMP:U", "TANK:L")]
    (tmp_path / "a.csv").write_text("stamp;pv;val\n" + "\n".join(rows) + "\n")
    run_map(MAP.format(more=""))
    with read_run(tmp_path / "out.h5") as run:
        assert run.read("pump")[0] == 0.5
