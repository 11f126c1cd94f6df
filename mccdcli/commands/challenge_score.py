"""`mccd challenge score`: what the diagnoses are worth against the truth."""

from __future__ import annotations

from pathlib import Path

import click

from mccdcli.options import common_options
from mccdcli.output import emit


@click.command("score")
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path), metavar="DIR")
@click.option("--made-by", "commands", multiple=True, metavar="TEXT", help="Command to print on the page; repeatable.")
@click.option("--so-far", is_flag=True, help="Score the cases before the first that was not run yet.")
@click.option("--from", "first", metavar="CASE", help="Leave out the cases before this one.")
@common_options("out", "json")
def score(
    folder: Path, commands: tuple[str, ...], so_far: bool, first: str | None, out: Path | None, as_json: bool
) -> int:
    """Reveal the truth of a challenge, check its seal, and score the diagnoses.

    Writes OUT.md and OUT.json (default: score in DIR). The exit code is 0 when every measure meets its requirement on
    enough cases, else 1. Enough are 300 cases with nothing hidden, and 20 of every family with one effect; the page
    names what has fewer.

    \b
    Examples:
      mccd challenge score DIR
      mccd challenge score DIR -o benchmarks/results/challenge
      mccd challenge score DIR --so-far
      mccd challenge score DIR --from 0278
    """
    from analysis.challenge.score import score_challenge
    from mccdcli.scores import written

    result = score_challenge(folder, so_far=so_far, first=first)
    part = f"{f' --from {first}' if first else ''}{' --so-far' * so_far}"
    made_by = commands or (f"mccd challenge run {folder}", f"mccd challenge score {folder}{part}")
    emit(result.plain(), as_json=as_json, text=written(result, out or folder / "score", made_by))
    return 0 if result.ok else 1
