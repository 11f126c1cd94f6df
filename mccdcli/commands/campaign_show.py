"""`mccd campaign show`: what a campaign asks for, or what a folder holds of one."""

from __future__ import annotations

from pathlib import Path

import click

from mccdcli.options import common_options
from mccdcli.output import emit, table


@click.command()
@click.argument("campaign", metavar="CAMPAIGN|FOLDER")
@common_options("json")
def show(campaign: str, as_json: bool) -> None:
    """Show the runs of CAMPAIGN with their settings, or how far the campaign in FOLDER has come.

    \b
    Examples:
      mccd campaign show paper
      mccd campaign show runs --json
    """
    from campaigns.playing.campaign import load_campaign
    from campaigns.playing.campaign_run import read_state

    state = read_state(campaign) if Path(campaign).is_dir() else None
    if state is not None:
        rows = [(run["name"], run["plan"], run["status"], run["log"]) for run in state["runs"]]
        emit(state, as_json=as_json, text=table(rows, heads=("run", "plan", "status", "log")))
        return
    loaded = load_campaign(campaign)
    rows = [(e.name, e.plan, ", ".join(f"{k}={v}" for k, v in e.settings.items()), "") for e in loaded.runs]
    plans = {name: plan.settings() for name, plan in loaded.plans().items()}
    emit(
        {"campaign": loaded.name, "title": loaded.title, "runs": plans},
        as_json=as_json,
        text=table(rows, heads=("run", "plan", "settings that differ", "")),
    )
