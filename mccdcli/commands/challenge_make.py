"""`mccd challenge make`: cases with hidden effects, and their truth sealed apart."""

from __future__ import annotations

from pathlib import Path

import click

from mccdcli.options import common_options
from mccdcli.output import emit
from mccdcli.progress import progress


@click.command("make")
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.option("--one", type=click.IntRange(0), default=1, show_default=True, help="Cases of one effect per family.")
@click.option("--faint", type=click.IntRange(0), default=0, show_default=True, help="Cases near detection per family.")
@click.option("--two", type=click.IntRange(0), default=0, show_default=True, help="Cases of two effects at once.")
@click.option("--none", "null", type=click.IntRange(0), default=1, show_default=True, help="Cases without any effect.")
@click.option("--outside", type=click.IntRange(0), default=0, show_default=True, help="Cases per family left out.")
@click.option("--family", "families", multiple=True, metavar="NAME", help="Hide only this family; may be repeated.")
@click.option("--shape", type=click.Choice(["full", "aperiodic", "short"]), help="Play only campaigns of this shape.")
@click.option("--jobs", type=click.IntRange(1), default=1, show_default=True, help="Cases to make at the same time.")
@common_options("seed", "json")
def make(
    folder: Path,
    one: int,
    faint: int,
    two: int,
    null: int,
    outside: int,
    families: tuple[str, ...],
    shape: str | None,
    jobs: int,
    seed: int,
    as_json: bool,
) -> None:
    """Make blind cases: logs of benches with hidden effects in DIR/cases, the sealed truth in DIR/truth.

    \b
    Examples:
      mccd challenge make DIR
      mccd challenge make DIR --one 20 --faint 10 --two 60 --none 300 --outside 3 --jobs 2
    """
    from analysis.challenge.families import members

    for family in families:
        members(family)  # before what makes cases is imported: a wrong name is refused at once

    from analysis.challenge.make import Counts, make_challenge

    counts = Counts(one=one, faint=faint, two=two, none=null, outside=outside)
    with progress("making") as report:
        seal = make_challenge(folder, counts, seed=seed, families=families, shape=shape, jobs=jobs, report=report)
    cases = len(list((folder / "cases").iterdir()))
    emit(
        {"folder": folder, "cases": cases, "seal": seal},
        as_json=as_json,
        text=f"{folder}: {cases} cases, their truth sealed as {seal[:16]}…",
    )
