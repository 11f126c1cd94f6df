"""What a whole campaign would take, counted without playing it and without what only logs need."""

from __future__ import annotations

from contextlib import closing

from campaigns.benches import open_bench
from campaigns.plans import Estimate, estimate
from campaigns.playing.campaign import Campaign, in_run
from campaigns.sizes import require_campaign


def estimate_campaign(campaign: Campaign, address: str, seed: int) -> dict[str, Estimate]:
    """Count every run without playing it; raises ConfigError for one that breaks a limit, naming it.

    One bench is asked for all runs: channels, axes and limits do not depend on the seed.
    """
    with closing(open_bench(address, seed)) as bench:
        counted = {}
        for name, plan in campaign.plans().items():
            with in_run(campaign, name):
                counted[name] = estimate(plan, bench)
    return within_bounds(campaign, counted)


def within_bounds(campaign: Campaign, counted: dict[str, Estimate]) -> dict[str, Estimate]:
    """Return what was counted of a campaign; raises ConfigError where all runs together take too long."""
    duration_s, size_bytes = (sum(getattr(one, what) for one in counted.values()) for what in ("duration_s", "bytes"))
    require_campaign(campaign.name, duration_s, size_bytes)
    return counted
