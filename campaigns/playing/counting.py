"""What a whole campaign would take, counted without playing it and without what only logs need."""

from __future__ import annotations

from contextlib import closing

from campaigns.benches import open_bench
from campaigns.plans import Estimate, estimate
from campaigns.playing.campaign import Campaign, in_run


def estimate_campaign(campaign: Campaign, address: str, seed: int) -> dict[str, Estimate]:
    """Count every run without playing it; raises ConfigError for one that breaks a limit, naming it.

    One bench is asked for all runs: channels, axes and limits do not depend on the seed.
    """
    with closing(open_bench(address, seed)) as bench:
        counted = {}
        for name, plan in campaign.plans().items():
            with in_run(campaign, name):
                counted[name] = estimate(plan, bench)
    return counted
