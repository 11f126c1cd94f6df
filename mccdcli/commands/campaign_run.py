"""`mccd campaign run`: play a whole campaign into a folder."""

from __future__ import annotations

from pathlib import Path

import click

from mccdcli.options import common_options
from mccdcli.output import emit, table
from mccdcli.trials import count_campaign, play_campaign
from sim_backend.safe_write import unnamed_folder


@click.command()
@click.argument("campaign", metavar="CAMPAIGN")
@click.option("--resume", is_flag=True, help="Continue in a folder that holds part of this campaign.")
@common_options()
def run(campaign: str, bench: str, out: Path | None, seed: int, dry_run: bool, as_json: bool, resume: bool) -> int:
    """Play every run of CAMPAIGN, a file or the name of a bundled one, each into a log of its own.

    Runs whose logs are complete are never repeated, and nothing is overwritten. The folder is the campaign's name
    unless --out names another.

    \b
    Examples:
      mccd campaign run campaigns/paper.toml --out runs
      mccd campaign run paper --out runs --resume
      mccd campaign run quick --dry-run
    """
    from campaigns.playing.campaign import load_campaign

    loaded = load_campaign(campaign)
    if dry_run:
        count_campaign(loaded, bench, seed, as_json=as_json)
        return 0
    folder = out or unnamed_folder(Path(loaded.name))
    played = play_campaign(loaded, folder, bench, seed, resume=resume)
    text = table([(name, str(log)) for name, log in played.logs.items()], heads=("run", "log"))
    result = {"campaign": loaded.name, "status": played.status, "folder": folder, "logs": played.logs}
    emit(result, as_json=as_json, text=f"{text}\n\n{played.status}")
    return played.exit_code
