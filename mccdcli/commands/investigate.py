"""`mccd investigate`: run, diagnose, choose the next experiment, run on, by itself."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mccdcli.failures import INTERRUPTED
from mccdcli.options import POSITIVE, Percent, WholeRange, common_options, given_note, without_option
from mccdcli.output import VERDICTS, emit, say, table
from mccdcli.progress import progress
from mccdcli.trials import count, settings_option
from sim_backend.safe_write import unnamed_folder

if TYPE_CHECKING:
    from analysis.diagnosis.investigation import Inquiry


@click.command()
@click.option("--model", "nominal", required=True, metavar="MODEL", help="Model to judge: a file or a bundled one.")
@click.option("--rounds", type=WholeRange(min=1), default=4, show_default=True, help="Largest number of experiments.")
@click.option(
    "--budget-s",
    type=POSITIVE,
    default=600.0,
    show_default=True,
    help="Maximum bench time for all experiments, in seconds. Chops after a named cause are not counted.",
)
@click.option("--first", metavar="PLAN", help="First plan, instead of a multisine as large as the bench allows.")
@without_option
@click.option(
    "--nominal-tolerance",
    type=Percent(0, 100, min_open=True),
    default="3%",
    show_default=True,
    help="Relative standard deviation of the model's own parameters, e.g. 3%.",
)
@click.option("--resume", is_flag=True, help="Continue the investigation that the folder holds.")
@settings_option
@common_options()
def investigate(
    bench: str,
    out: Path | None,
    seed: int,
    dry_run: bool,
    as_json: bool,
    nominal: str,
    rounds: int,
    budget_s: float,
    first: str | None,
    without: tuple[str, ...],
    nominal_tolerance: float,
    resume: bool,
    settings: dict[str, Any],
) -> int:
    """Find out what a model gets wrong about a bench: run, diagnose, choose the next experiment, run on.

    Ends when the verdict is consistent or named, when no experiment within the bench's limits would change it, or when
    the rounds or the budget are spent. `mccd diagnose --help` explains the verdicts. Once a cause is named, the bench
    also plays chops with the feed-forward of each model. All logs and diagnoses are kept in the folder investigation,
    or in --out. --set changes the plan of --first. The exit code is 0 when the last verdict is consistent, else 1.
    Ctrl-C ends the investigation after the current segment, with exit code 130; --resume continues it.

    \b
    Examples:
      mccd investigate --bench sim:bench.toml --model nominal.toml -o DIR
      mccd investigate --bench serial:/dev/ttyUSB0@921600 --model nominal.toml --budget-s 120 --json
      mccd investigate --model nominal.toml --first hysteresis --set 'torques_nm=[0.02]' --set 'offsets_rad=[]'
    """
    # what investigates comes last: a wrong option and a dry run do not wait for it
    from campaigns.plans import make_plan
    from sim_backend.errors import ConfigError
    from sim_backend.model import load_model

    if settings and first is None:
        raise ConfigError("--set belongs to the plan of --first, and none is given; name it with --first")
    model = load_model(nominal)
    plan = None if first is None else make_plan(first, settings)
    if dry_run:
        begin = plan or _chosen(bench, seed, model)
        count({begin.name: begin}, bench, seed, as_json=as_json)
        return 0

    from analysis.diagnosis.investigation import Quest
    from analysis.diagnosis.investigation import investigate as inquire
    from analysis.diagnosis.pipeline import Options
    from sim_backend.memory import keep_long_arrays

    keep_long_arrays()
    options = Options(tolerance=nominal_tolerance, without=without, seed=seed)
    quest = Quest(bench, model, seed, rounds, budget_s, plan, options, given_note())
    with progress("investigating") as report:
        found = inquire(quest, out or unnamed_folder(Path("investigation")), resume=resume, report=report, remark=say)
    emit(found, as_json=as_json, text=_text(found), colours=VERDICTS)
    if found.paused:
        return INTERRUPTED
    return 0 if found.verdict == "consistent" else 1


def _chosen(bench: str, seed: int, model: Any) -> Any:
    from contextlib import closing

    from analysis.diagnosis.experiment.planned import first_plan
    from campaigns.benches import open_bench

    with closing(open_bench(bench, seed)) as opened:
        return first_plan(opened, model)


def _text(found: Inquiry) -> str:
    rows = [
        (str(r.number), r.plan, f"{r.duration_s:.1f} s", r.verdict or "not judged", _causes(r), r.log)
        for r in found.rounds
    ]
    parts = [table(rows, heads=("round", "plan", "bench time", "verdict", "causes", "log"))] if rows else []
    if found.rounds and found.rounds[-1].sentence:
        parts.append(found.rounds[-1].sentence)
    parts.append(
        f"It ended because {found.reason}." if not found.paused else f"It was {found.reason}; --resume goes on."
    )
    parts.append(str(found.folder))
    return "\n\n".join(parts)


def _causes(entry: Any) -> str:
    return ", ".join(entry.causes) or " or ".join(name for tied in entry.ambiguous for name in tied) or "none"
