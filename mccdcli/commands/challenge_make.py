"""`mccd challenge make`: cases with hidden effects, and their truth sealed apart."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from mccdcli.options import NewPath, WholeRange, common_options
from mccdcli.output import emit
from mccdcli.progress import Report, progress


@click.command("make")
@click.argument("folder", type=NewPath(), metavar="DIR")
@click.option(
    "--generator",
    type=click.Choice(["first", "second"]),
    default="first",
    show_default=True,
    help="Which generator makes the cases; the two share no law (a formula by which an effect is simulated).",
)
@click.option("--one", type=WholeRange(0), default=1, show_default=True, help="Cases with one effect, per family.")
@click.option(
    "--faint",
    type=WholeRange(0),
    default=0,
    show_default=True,
    help="First generator: cases with one effect near its detection limit, per family.",
)
@click.option("--two", "--pairs", type=WholeRange(0), default=0, show_default=True, help="Cases with two effects.")
@click.option("--none", "null", type=WholeRange(0), default=1, show_default=True, help="Cases with no effect.")
@click.option(
    "--outside",
    type=WholeRange(0),
    default=0,
    show_default=True,
    help="Cases with one effect that the diagnosis leaves out of its search, per family.",
)
@click.option(
    "--twisted",
    type=WholeRange(0),
    default=0,
    show_default=True,
    help="Second generator: cases with a listed effect whose law is changed, per such law.",
)
@click.option(
    "--unlisted",
    type=WholeRange(0),
    default=0,
    show_default=True,
    help="Second generator: cases of a law that no listed effect reproduces, per such law.",
)
@click.option(
    "--reserved",
    is_flag=True,
    help="Second generator: hide the third of the unlisted laws that is kept for final scores, instead of the others.",
)
@click.option(
    "--family",
    "families",
    multiple=True,
    metavar="NAME",
    help="Family (second generator: law or effect) to hide; repeatable.  [default: all]",
)
@click.option(
    "--shape",
    type=click.Choice(["full", "aperiodic", "short"]),
    help="First generator: make only campaigns of this kind. full: periodic multisines and more, 136,000 samples. "
    "aperiodic: nothing repeats. short: 13,200 samples.  [default: mixed, 70, 20 and 10 % of the cases]",
)
@click.option(
    "--jobs", type=WholeRange(1), default=1, show_default=True, help="Number of cases to make at the same time."
)
@common_options("seed", "json")
def make(
    folder: Path,
    generator: str,
    one: int,
    faint: int,
    two: int,
    null: int,
    outside: int,
    twisted: int,
    unlisted: int,
    reserved: bool,
    families: tuple[str, ...],
    shape: str | None,
    jobs: int,
    seed: int,
    as_json: bool,
) -> None:
    """Make blind cases: logs of benches with hidden effects in DIR/cases, the sealed truth in DIR/truth.

    A family is a cause that the diagnosis can name, with all laws by which it is simulated. Listed are the effects that
    the diagnosis searches (`mccd model effects`). Numbers are of cases in all, unless they are per family or law.

    \b
    Examples:
      mccd challenge make DIR
      mccd challenge make DIR --one 20 --faint 10 --two 60 --none 300 --outside 3 --jobs 2
      mccd challenge make DIR --generator second --one 2 --pairs 20 --outside 1 --twisted 3 --unlisted 3
    """
    _refuse(generator, {"--faint": faint, "--shape": shape}, "second")
    _refuse(generator, {"--twisted": twisted, "--unlisted": unlisted, "--reserved": reserved}, "first")
    with progress("making") as report:
        if generator == "second":
            seal = _second(folder, (null, one, two, outside, twisted, unlisted), reserved, families, seed, jobs, report)
        else:
            seal = _first(folder, (one, faint, two, null, outside), families, shape, seed, jobs, report)
    cases = len(list((folder / "cases").iterdir()))
    again = _drawn_again(folder)
    emit(
        {"folder": folder, "cases": cases, "seal": seal, "drawn_again": again},
        as_json=as_json,
        text=f"{folder}: {cases} cases, their truth sealed as {seal[:16]}…"
        + (f"; {again} draws were given up and drawn again" if again else ""),
    )


def _refuse(generator: str, given: dict[str, Any], lacks: str) -> None:
    """Raise ConfigError for an option that the generator lacks."""
    from sim_backend.errors import ConfigError

    for option, value in given.items():
        if generator == lacks and value:
            raise ConfigError(f"the {lacks} generator has no {option}: leave it out, or take the other generator")


def _first(
    folder: Path,
    counts: tuple[int, ...],
    families: tuple[str, ...],
    shape: str | None,
    seed: int,
    jobs: int,
    report: Report,
) -> str:
    from analysis.challenge.families import members

    for family in families:
        members(family)  # before what makes cases is imported: a wrong name is refused at once

    from analysis.challenge.make import Counts, make_challenge

    return make_challenge(folder, Counts(*counts), seed=seed, families=families, shape=shape, jobs=jobs, report=report)


def _second(
    folder: Path,
    counts: tuple[int, ...],
    reserved: bool,
    names: tuple[str, ...],
    seed: int,
    jobs: int,
    report: Report,
) -> str:
    from analysis.challenge.second.make import Counts, make_challenge

    return make_challenge(folder, Counts(*counts), seed=seed, names=names, kept_back=reserved, jobs=jobs, report=report)


def _drawn_again(folder: Path) -> int:
    """Return how many draws were given up; the number alone says nothing of what is hidden."""
    from analysis.challenge.truth import reveal

    return sum(n for case in reveal(folder).cases.values() for n in case.redrawn.values())
