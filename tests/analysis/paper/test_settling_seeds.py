"""The spread of θx over seeds is the study's, in the row and in Fig. A3."""

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from analysis.paper.figure_a3 import figure_a3
from analysis.paper.numbers import paper_tables
from analysis.paper.rows import build_table
from analysis.paper.settling_seeds import settling_seeds
from analysis.paper.table_6_6 import PROJECT, table_6_6
from campaigns.playing.campaign import load_campaign
from tests.docs.test_pages import ROOT

STUDY = json.loads((ROOT / settling_seeds().source).read_text(encoding="utf-8"))


class Settled:
    """A campaign with fast chops and nothing else: settled after so many ms, after so long a learning on a bench."""

    def __init__(self, learning_s=10.0, kind="sim", name="as-built", **ms):
        self.ms = ms
        settings = {"tuning": {"learning_s": learning_s}}
        self.run = SimpleNamespace(header=SimpleNamespace(bench={"kind": kind, "name": name}, settings=settings))

    def settle(self, strategy, alpha_deg, phase="chop"):
        time_ms = self.ms.get({0.0: "x", 90.0: "y"}[alpha_deg]) if strategy in ("repetitive", "designed") else None
        if time_ms is None:
            return None
        times_s = 1e-3 * np.array([time_ms, 0.5 * time_ms])
        return SimpleNamespace(
            run=self.run,
            settling=lambda axis: SimpleNamespace(time_s=times_s),
            power=lambda *constants: SimpleNamespace(total_w=0.1, peak_a=2.0),
        )

    def chop(self, *of):
        return None

    def drift(self, strategy):
        return None


def campaign(**given) -> Any:
    """What tables and figures ask of measurements."""
    return Settled(**given)


def test_the_bundled_counts_are_the_studys():
    seeds, told = settling_seeds(), STUDY["settling_s"]
    assert seeds.settling_s.size == STUDY["trials"] == 200
    values, counts = np.unique(seeds.settling_s, return_counts=True)
    assert {f"{1e3 * v:.1f}": int(n) for v, n in zip(values, counts, strict=True)} == STUDY["count_by_ms"]
    for share, name in ((0.05, "5 %"), (0.5, "median"), (0.95, "95 %")):
        # settling goes in samples of 0.1 ms
        assert seeds.quantile_ms(share) == pytest.approx(1e3 * told[name], abs=0.05)
    assert f"learning_s = {seeds.learning_s:.1f}" in STUDY["study"]


def test_the_study_has_the_campaigns_settings():
    (run,) = [r for r in load_campaign("paper").runs if r.name == "settle-repetitive-x"]
    assert run.settings["tuning"]["learning_s"] == settling_seeds().learning_s


def test_the_row_has_the_share_that_agrees_and_the_range():
    rows = table_6_6(campaign(x=34.6, y=4.5))
    found = rows["settling theta_x"]
    assert found.value == pytest.approx(34.6e-3)
    # by hand from the study's counts: 27.5 to 36.5 ms
    near = sum(n for ms, n in STUDY["count_by_ms"].items() if 27.5 <= float(ms) <= 36.5)
    assert found.share == near / 200 == 0.405
    assert "40 % of 200 seeds" in found.note and "25.0–34.6 ms" in found.note and "Fig. A3" in found.note
    assert "seed" not in rows["settling theta_y"].note and rows["settling theta_y"].share is None
    # the study says nothing of this project's controller
    assert "seed" not in table_6_6(campaign(x=4.5, y=4.5), PROJECT)["settling theta_x"].note


def test_one_run_of_what_depends_on_the_seed_is_no_agreement():
    table = build_table("6.6", paper_tables()["6.6"], table_6_6(campaign(x=34.6, y=4.5)))
    (row,) = [row for row in table.rows if row.number.key == "settling theta_x"]
    assert row.deviation is not None and row.number.tolerance is not None
    assert abs(row.deviation) < row.number.tolerance and row.noisy and row.ok is None and row.missed


@pytest.mark.parametrize("other", [{"learning_s": 8.0}, {"kind": "serial"}, {"name": "another"}])
def test_the_study_counts_for_no_run_that_it_did_not_repeat(other):
    found = table_6_6(campaign(x=34.6, **other))["settling theta_x"]
    assert found.share is None and "seed" not in found.note


@pytest.mark.parametrize(("ms", "drawn"), [(34.6, True), (float("inf"), False), (None, False)])
def test_the_figure_shows_all_seeds_the_paper_and_this_campaign(ms, drawn):
    figure = figure_a3(campaign(x=ms))
    assert settling_seeds().source in figure.caption
    numbers = figure.numbers()
    seeds = numbers[numbers.series == "seeds"]
    assert len(seeds) == 200 and seeds.y.iloc[-1] == 100.0
    at = seeds[seeds.x <= 25.35]
    assert len(at) == 119 and at.y.max() == pytest.approx(59.5)
    assert set(numbers[numbers.series == "paper"].x) == {32.0}
    ours = numbers[numbers.series == "this campaign"].x
    assert (set(np.round(ours, 6)) == {34.6}) if drawn else len(ours) == 0
