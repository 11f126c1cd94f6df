"""A campaign that is counted without being played."""

from __future__ import annotations

from campaigns.benches import open_bench
from campaigns.plans import estimate, make_plan
from campaigns.playing import counting
from campaigns.playing.campaign import load_campaign, run_seed


def test_a_campaign_is_counted_on_one_bench_as_each_run_would_be_on_its_own(monkeypatch):
    opened: list[tuple[str, int]] = []

    def opening(*asked):
        opened.append(asked)
        return open_bench(*asked)

    monkeypatch.setattr(counting, "open_bench", opening)
    campaign = load_campaign("quick")
    counted = counting.estimate_campaign(campaign, "sim", 7)
    assert opened == [("sim", 7)]
    alone = {
        e.name: estimate(make_plan(e.plan, e.settings), open_bench("sim", run_seed(7, e.name))) for e in campaign.runs
    }
    assert counted == alone
