"""`mccd campaign list`: the bundled campaigns, and the plans that a campaign can use."""

from __future__ import annotations

import click

from mccdcli.options import common_options
from mccdcli.output import emit, table


@click.command("list")
@click.option("--plans", is_flag=True, help="List the plans with their settings instead.")
@common_options("json")
def list_campaigns(plans: bool, as_json: bool) -> None:
    """List the campaigns that come with mccd, or the plans that campaigns are made of.

    \b
    Examples:
      mccd campaign list
      mccd campaign list --plans --json
    """
    from campaigns.plans import all_plans
    from campaigns.playing.campaign import bundled_campaigns, load_campaign

    if plans:
        known = [(plan.name, plan.title, plan().settings()) for plan in all_plans().values()]
        lines = [(name, title, ", ".join(settings)) for name, title, settings in known]
        described: object = {
            "plans": [{"plan": name, "title": title, "settings": settings} for name, title, settings in known]
        }
        emit(described, as_json=as_json, text=table(lines, heads=("plan", "what", "settings")))
        return
    loaded = [load_campaign(name) for name in bundled_campaigns()]
    rows = [(c.name, str(len(c.runs)), c.title) for c in loaded]
    result = {"campaigns": [{"name": c.name, "runs": len(c.runs), "title": c.title} for c in loaded]}
    emit(result, as_json=as_json, text=table(rows, heads=("campaign", "runs", "what")))
