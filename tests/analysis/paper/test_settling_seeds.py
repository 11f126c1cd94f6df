"""The spread of θx over seeds is the study's, in the row and in Fig. A3."""

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from analysis.paper.figure_a3 import figure_a3
from analysis.paper.settling_seeds import settling_seeds
from analysis.paper.table_6_6 import PROJECT, table_6_6
from campaigns.playing.campaign import load_campaign
from tests.docs.test_pages import ROOT

STUDY = json.loads((ROOT / settling_seeds().source).read_text(encoding="utf-8"))


class Settled:
    """A campaign with fast chops and nothing else: settled after so many ms."""

    def __init__(self, **ms):
        self.ms = ms

    def settle(self, strategy, alpha_deg, phase="chop"):
        time_ms = self.ms.get({0.0: "x", 90.0: "y"}[alpha_deg]) if strategy in ("repetitive", "designed") else None
        if time_ms is None:
            return None
        times_s = 1e-3 * np.array([time_ms, 0.5 * time_ms])
        return SimpleNamespace(
            settling=lambda axis: SimpleNamespace(time_s=times_s),
            power=lambda *constants: SimpleNamespace(total_w=0.1, peak_a=2.0),
        )

    def chop(self, *of):
        return None

    def drift(self, strategy):
        return None


def campaign(**ms) -> Any:
    """What tables and figures ask of measurements."""
    return Settled(**ms)


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


def test_the_row_has_the_range_and_its_source():
    rows = table_6_6(campaign(x=34.6, y=4.5))
    note = rows["settling theta_x"].note
    assert rows["settling theta_x"].value == pytest.approx(34.6e-3)
    assert "25.0–34.6 ms" in note and "200 seeds" in note and settling_seeds().source in note
    assert "seed" not in rows["settling theta_y"].note
    # the study says nothing of this project's controller
    assert "seed" not in table_6_6(campaign(x=4.5, y=4.5), PROJECT)["settling theta_x"].note


@pytest.mark.parametrize(("ms", "drawn"), [(34.6, True), (float("inf"), False), (None, False)])
def test_the_figure_shows_all_seeds_the_paper_and_this_campaign(ms, drawn):
    numbers = figure_a3(campaign(x=ms)).numbers()
    seeds = numbers[numbers.series == "seeds"]
    assert len(seeds) == 200 and seeds.y.iloc[-1] == 100.0
    at = seeds[seeds.x <= 25.35]
    assert len(at) == 119 and at.y.max() == pytest.approx(59.5)
    assert set(numbers[numbers.series == "paper"].x) == {32.0}
    ours = numbers[numbers.series == "this campaign"].x
    assert (set(np.round(ours, 6)) == {34.6}) if drawn else len(ours) == 0
