"""What a design writes for a bench that says less of itself than the one of the paper."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path

import pandas as pd
import pytest

from analysis.design.api import Options, design_controller
from analysis.design.output import axis_rows, write_design
from analysis.pages.canvas import COLOURS
from campaigns.benches import open_bench
from campaigns.log import read_run
from campaigns.plans import make_plan
from campaigns.playing.runner import run_plan
from sim_backend.model import load_model

POWER = "power of a 5 Hz chop, W"


@pytest.mark.parametrize("stated", [True, False])
def test_the_power_of_a_bench_that_states_no_coils_is_not_stated(tmp_path: Path, stated: bool) -> None:
    bench = open_bench("sim", 3)
    limits = bench.limits if stated else dataclasses.replace(bench.limits, coil=None)
    run_plan(make_plan("rest", {"duration_s": 10.0}), bench, tmp_path / "rest.h5", seed=3, note="<b>cold</b>")
    with read_run(tmp_path / "rest.h5") as rest:
        designed = design_controller(load_model("design"), [rest], limits, bench.axes, Options(seed=3))
    told = {what: value for _, what, value, _ in axis_rows(designed)}
    files = write_design(designed, tmp_path)
    page = files["index.html"].read_text(encoding="utf-8")
    (uid,) = designed.sources
    assert f'<code title="{uid}">{uid[:8]}</code> (&lt;b&gt;cold&lt;/b&gt;)' in page
    drawn = (tmp_path / "figures" / "sensitivity.svg").read_text(encoding="utf-8")
    band = set(re.findall(rf'style="fill: none; stroke-dasharray: ([^;]*);[^"]*stroke: {COLOURS[5]};', drawn))
    assert len(band) == 2, "the lowest and the highest of the drawn plants look alike"
    price = pd.read_csv(tmp_path / "figures" / "price.csv")
    numbers = json.loads(files["design.json"].read_text(encoding="utf-8"))["axes"]["theta_x"]["move"]["power_w"]
    assert ("not stated by the bench" in page) is not stated and ">nan" not in page
    assert set(price["y_quantity"]) == ({"power (W)"} if stated else set()) | {"peak current (A)"}
    assert set(price["x_quantity"].dropna()) <= {"", "settling (ms)"} and price["y"].notna().all()
    if stated:
        assert float(told[POWER]) > 0.0 and numbers > 0.0
    else:
        assert told[POWER] == "not stated by the bench" and numbers is None
