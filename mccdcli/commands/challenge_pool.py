"""`mccd challenge pool`: one score of a challenge that was diagnosed and scored in parts."""

from __future__ import annotations

from pathlib import Path

import click

from mccdcli.options import common_options
from mccdcli.output import emit


@click.command("pool")
@click.argument(
    "scores",
    nargs=-1,
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="SCORE.json...",
)
@common_options("out", "json")
def pool(scores: tuple[Path, ...], out: Path | None, as_json: bool) -> int:
    """Make one score of several.

    The scores may be of parts of one challenge, or of several challenges. Writes OUT.md and OUT.json (default: pooled,
    in the current folder). The exit code is 0 when every measure meets its requirement on enough cases, as `mccd
    challenge score --help` says, else 1. The page names every version that diagnosed a case.

    \b
    Examples:
      mccd challenge score DIR --so-far -o monday
      mccd challenge score DIR --from 0376 -o tuesday
      mccd challenge pool monday.json tuesday.json -o both
    """
    from analysis.challenge.pool import pool as pooled
    from mccdcli.scores import written

    result = pooled(scores)
    made_by = (" ".join(["mccd challenge pool", *(path.name for path in scores)]),)
    emit(result.plain(), as_json=as_json, text=written(result, out or Path("pooled"), made_by))
    return 0 if result.ok else 1
