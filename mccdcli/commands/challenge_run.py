"""`mccd challenge run`: the diagnosis of every case, each in a process of its own."""

from __future__ import annotations

from pathlib import Path

import click

from mccdcli.options import RealRange, WholeRange, common_options
from mccdcli.output import emit
from mccdcli.progress import progress


@click.command("run")
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path), metavar="DIR")
@click.option("--jobs", type=WholeRange(1), default=1, show_default=True, help="Number of diagnoses at the same time.")
@click.option(
    "--time-limit",
    "limit_s",
    type=RealRange(1.0),
    default=300.0,
    show_default=True,
    metavar="SECONDS",
    help="Stop a diagnosis after this time.",
)
@click.option("--from", "first", metavar="CASE", help="Leave out the cases before this one.")
@common_options("json")
def run(folder: Path, jobs: int, limit_s: float, first: str | None, as_json: bool) -> None:
    """Diagnose every case of a challenge that has no result yet.

    Each diagnosis is `mccd diagnose --no-page` in a process of its own. It gets the case's logs and nominal model,
    and, for a family that is to be left out of the search, its name.

    \b
    Examples:
      mccd challenge run DIR --jobs 2
    """
    from analysis.challenge.run import run_challenge

    with progress("diagnosing") as report:
        outcomes = run_challenge(folder, jobs=jobs, limit_s=limit_s, first=first, report=report)
    stopped = sum(o.exit_code is None for o in outcomes)
    slowest_s = max((o.wall_s for o in outcomes), default=0.0)
    summary = f"{len(outcomes)} diagnoses, {stopped} stopped at {limit_s:g} s, the slowest took {slowest_s:.1f} s"
    emit({"folder": folder, "outcomes": outcomes}, as_json=as_json, text=f"{folder}: {summary}")
