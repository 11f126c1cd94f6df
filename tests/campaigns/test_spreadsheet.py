"""No text of a table is a formula, every text comes back, and numbers are left alone."""

from __future__ import annotations

import csv

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaigns.importing import import_run
from campaigns.log import Channel, LogWriter, read_run
from campaigns.log.export import save
from campaigns.spreadsheet import as_named, inert, inert_frame

NAMES = ("=1+1", "+cmd|' C calc'!A0", "-y", "@SUM(A1)", "'=quoted", "''=twice", "'plain", "theta", "１")


@given(st.text(alphabet=st.sampled_from(list("'=+-@\t\r\n＝x1. ")), max_size=6))
def test_every_text_comes_back_and_is_no_formula(text):
    cell = inert(text)
    assert as_named(cell) == text
    if cell[:1] and cell[0] in "=+-@\t\r\n＝":
        float(cell)  # a number


def test_numbers_of_a_table_are_untouched():
    frame = pd.DataFrame({"=x": [-1.5, 2.0], "note": ["=1+1", "-2"], "none": [None, "@x"]})
    assert inert_frame(frame).to_csv(index=False) == "'=x,note,none\n-1.5,'=1+1,\n2.0,-2,'@x\n"


@pytest.mark.filterwarnings("error")
def test_names_of_a_log_survive_the_way_through_a_table(tmp_path):
    channels = [Channel(name, "rad", "output", "theta_x", 100.0) for name in NAMES]
    values = {name: np.random.default_rng(k).normal(size=50) for k, name in enumerate(NAMES)}
    with LogWriter.create(tmp_path / "run.h5", channels, test="t", bench={"kind": "sim"}) as log:
        log.append(values)
    with read_run(tmp_path / "run.h5") as run:
        save(run, tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(newline="") as file:
        heads, first, *_ = csv.reader(file)
    assert not any(head[0] in "=+-@" for head in heads)
    assert [float(cell) for cell in first[1:]] == [values[name][0] for name in NAMES]
    lines = ["[log]", "test = 't'", "source = 'run.csv'", "time = 'time (s)'"]
    for k, name in enumerate(NAMES):
        lines += [f"[channels.c{k}]", f'select = "{name} (rad)"', "unit = 'rad'", "role = 'output'", "dof = 'theta_x'"]
    (tmp_path / "map.toml").write_text("\n".join(lines))
    import_run(tmp_path / "map.toml", tmp_path / "back.h5")
    with read_run(tmp_path / "back.h5") as run:
        for k, name in enumerate(NAMES):
            np.testing.assert_array_equal(run.read(f"c{k}"), values[name])
