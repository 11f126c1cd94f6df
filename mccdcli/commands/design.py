"""`mccd design`: a controller from an identified model and a record of the bench at rest."""

from __future__ import annotations

from contextlib import ExitStack, closing
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mccdcli.options import POSITIVE, Percent, common_options
from mccdcli.output import emit, say, table
from mccdcli.progress import Report, progress
from mccdcli.trials import count, play
from sim_backend.safe_write import unnamed_folder

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from analysis.design.api import Designed
    from analysis.design.stages import StageResult
    from campaigns.log import Run
    from campaigns.plans import Plan
    from sim_backend.bench import Identity, Limits


@click.command()
@click.option("--model", required=True, metavar="MODEL.toml", help="Identified model, extended or not.")
@click.option(
    "--log",
    "given",
    multiple=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="RUN.h5",
    help="Log to design from: rest, sweeps, hysteresis loops; repeatable. Without one at rest, one is recorded.",
)
@click.option(
    "--settling", type=POSITIVE, metavar="MS", help="Time within which a move must settle, at most 100.  [default: 5.0]"
)
@click.option(
    "--reach",
    type=POSITIVE,
    default=8.5,
    show_default=True,
    metavar="MRAD",
    help="Longest move that must settle in it.",
)
@click.option(
    "--tolerance",
    type=Percent(0, 50, max_open=True),
    default="1%",
    show_default=True,
    help="How far every mode's frequency may be off, ±, in addition to the standard deviation that the model states. "
    "Damping may always be off by 20 %, participation in the motion by 2 %, the lowest frequency by another 1 %.",
)
@click.option(
    "--max-power",
    type=POSITIVE,
    metavar="W",
    help="Instead of --settling: the fastest move whose 5 Hz chop dissipates at most this power.",
)
@click.option("--unswept", is_flag=True, help="Trust the model where no --log sweeps an axis.")
@click.option(
    "--stages",
    is_flag=True,
    help="Also play a 5 Hz chop with each designed strategy and list results. --dry-run does not count them.",
)
@common_options()
def design(
    bench: str,
    out: Path | None,
    seed: int,
    dry_run: bool,
    as_json: bool,
    model: str,
    given: tuple[Path, ...],
    settling: float | None,
    reach: float,
    tolerance: float,
    max_power: float | None,
    unswept: bool,
    stages: bool,
) -> int:
    """Design feed-forward, feedback and learning on an identified model, against the noise of the bench at rest.

    Writes controller.toml, design.json, index.html and figures into the folder design, or into --out. The bench
    supplies its axes and limits, and a record of its noise when no --log has one; --stages plays chops on it. Logs of
    another bench, a model that no sweep confirms (unless --unswept), and a design that would be unstable, break a limit
    or miss a requirement are refused with the reason (exit code 2).

    \b
    Examples:
      mccd design --model nominal.toml --log nominal.runs/sweep-theta_x.h5 --log hysteresis.h5 --stages
      mccd design --model nominal.toml --max-power 0.15 --out thrifty
      mccd settle --strategy designed --controller design/controller.toml
    """
    from campaigns.plans import make_plan
    from sim_backend.model import load_model

    _require_one(settling, max_power)
    nominal, plan = load_model(model), make_plan("rest", {})
    if dry_run:
        recorded = _rest_in(out or Path("design")).exists() or _holds_rest(given, plan)
        return _counted({} if recorded else {plan.name: plan}, bench, seed, stages=stages, as_json=as_json)

    from analysis.design.api import Options, design_controller, require_strokes
    from analysis.design.output import document, prepare_folder, write_controller, write_design
    from analysis.design.uncertainty import Tolerance
    from campaigns.progress import part_of

    options = Options(1e-3 * reach, 1e-3 * (settling or 5.0), max_power, tolerance=Tolerance(tolerance), seed=seed)
    limits, axes, identity = _what_it_may(bench, seed)
    driven = require_strokes(nominal, limits, axes, options)  # before anything is written or played
    with ExitStack() as stack:
        runs = _logs(stack, given, identity, () if unswept else driven)
        folder = prepare_folder(out or unnamed_folder(Path("design")))
        if code := _add_rest(runs, stack, plan, bench, folder, seed):
            return code
        with progress("designing") as report:
            first = part_of(report, 0.0, 0.5 if stages else 0.9)  # designing takes about as long as playing
            designed = design_controller(nominal, runs, limits, axes, options, first)
            _tell_unswept(designed)
            path = write_controller(designed, folder)
            rows = _played(designed, path, bench, seed, part_of(report, 0.5, 0.95)) if stages else []
            report(0.95, 1.0, "figures")
            files = {"controller": path, **write_design(designed, folder, rows)}
    emit({**document(designed, rows), "files": files}, as_json=as_json, text=_text(designed, rows, [*files.values()]))
    return 0


def _counted(plans: Mapping[str, Plan], bench: str, seed: int, *, stages: bool, as_json: bool) -> int:
    """Show what recording `plans` would take, and what is not counted."""
    if stages:
        say("mccd: the chops of --stages are not counted: how long they learn is not known before the design")
    count(plans, bench, seed, as_json=as_json)
    return 0


def _logs(stack: ExitStack, given: Sequence[Path], identity: Identity, driven: Sequence[str]) -> list[Run]:
    """Return the logs, opened on `stack`; raises ConfigError for another bench's, and without sweeps of `driven`."""
    from analysis.design.api import require_of_bench, require_swept
    from campaigns.log import read_run

    runs = [stack.enter_context(read_run(path)) for path in given]
    require_of_bench(runs, asdict(identity))
    require_swept(runs, driven)
    return runs


def _add_rest(runs: list[Run], stack: ExitStack, plan: Plan, bench: str, folder: Path, seed: int) -> int:
    """Record the bench at rest and add its log, unless one of `runs` is; return the exit code of recording it."""
    from campaigns.log import read_run

    if any(run.header.test == plan.name for run in runs):
        return 0
    log, code = _at_rest(plan, bench, folder, seed)
    if not code:
        runs.append(stack.enter_context(read_run(log)))
    return code


def _holds_rest(given: Sequence[Path], plan: Plan) -> bool:
    """Tell whether one of the logs is of the bench at rest."""
    if not given:  # then counting needs nothing that reads logs
        return False
    from campaigns.log import read_run

    for path in given:
        with read_run(path) as run:
            if run.header.test == plan.name:
                return True
    return False


def _rest_in(folder: Path) -> Path:
    """Return where the bench at rest is recorded: there already where a design was refused."""
    return folder / "rest.h5"


def _require_one(settling: float | None, max_power: float | None) -> None:
    """Raise UsageError where both say which move to take."""
    if settling is not None and max_power is not None:
        raise click.UsageError("--settling and --max-power both choose the move; give one of them")


def _tell_unswept(designed: Designed) -> None:
    """Say for which axes nothing measured vouches for the model."""
    for one in designed.axes:
        if one.learning.lines_hz is None:
            say(f"mccd: no --log sweeps {one.dof}: whether the bench has the modes of the model was not checked")


def _what_it_may(bench: str, seed: int) -> tuple[Limits, tuple[str, ...], Identity]:
    """Return the limits, the axes and the identity of a bench."""
    from campaigns.benches import open_bench

    with closing(open_bench(bench, seed)) as opened:
        return opened.limits, opened.axes, opened.identity


def _at_rest(plan: Plan, bench: str, folder: Path, seed: int) -> tuple[Path, int]:
    """Return the log of the bench at rest in `folder`, recorded unless a design that was refused has left one."""
    log = _rest_in(folder)
    return (log, 0) if log.exists() else (log, play(plan, bench, log, seed).exit_code)


def _played(designed: Designed, controller: Path, bench: str, seed: int, report: Report) -> list[StageResult]:
    from analysis.design.stages import play_stages
    from campaigns.benches import open_bench

    axes = [one.dof for one in designed.axes]
    return play_stages(lambda: open_bench(bench, seed), controller, axes, seed=seed, report=report)


def _text(designed: Designed, stages: list[StageResult], files: list[Path]) -> str:
    from analysis.design.output import AXIS_HEADS, axis_rows
    from analysis.design.stages import STAGE_HEADS, stage_rows

    parts = [table(axis_rows(designed), heads=AXIS_HEADS)]
    if stages:
        parts.append(table(stage_rows(stages), heads=STAGE_HEADS))
    return "\n\n".join([*parts, ", ".join(str(f) for f in files if f.suffix in (".toml", ".json", ".html"))])
