"""`mccd report`: the paper's tables and figures beside ours."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from mccdcli.design_ahead import DesignAhead
from mccdcli.junit import Case, prepare_junit, write_junit
from mccdcli.options import NewPath, common_options
from mccdcli.output import BAD, GOOD, emit, say, table
from mccdcli.pdf import pdf_option, printed
from mccdcli.progress import progress
from mccdcli.trials import count_campaign, play_campaign
from sim_backend.safe_write import unnamed_folder

if TYPE_CHECKING:
    from collections.abc import Mapping

    from analysis.paper.known_misses import Known
    from analysis.paper.measured import Measured
    from analysis.report import Report
    from campaigns.playing.campaign import Campaign


OWN_LOGS: Final = "310 MB"
"""What the logs of this project's own controller take, about: how long it learns is not known before it is designed."""


@click.command()
@click.option(
    "--campaign",
    default="paper",
    show_default=True,
    metavar="CAMPAIGN",
    help="The campaign to report: a bundled one or a file.",
)
@click.option(
    "--design/--no-design",
    "own",
    default=True,
    show_default=True,
    help="Also design a controller from the campaign's logs, play it, and set its results beside the others. --dry-run "
    f"does not count its logs, about {OWN_LOGS}.",
)
@click.option(
    "--check",
    is_flag=True,
    help="Exit with 1 if a predicted number leaves its tolerance, is not determined, or exceeds a bound.",
)
@click.option(
    "--known-misses",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help='With --check: numbers that may fail. TOML with a section per table, as ["6.4"], of lines "row" = "reason".',
)
@click.option(
    "--junit",
    type=NewPath(dir_okay=False),
    metavar="FILE",
    help="With --check: also write every predicted number as a case of a JUnit file, which CI shows.",
)
@pdf_option("report.pdf")
@common_options()
def report(
    bench: str,
    out: Path | None,
    seed: int,
    dry_run: bool,
    as_json: bool,
    campaign: str,
    own: bool,
    check: bool,
    known_misses: Path | None,
    junit: Path | None,
    pdf: bool,
) -> int:
    """Run what is missing of a campaign, then build its report: every table and figure beside the paper's.

    The report is written to the folder --out (default: report), its logs to OUT/campaign, those of this project's own
    controller to OUT/designed. --check names each predicted number that is outside its tolerance or not determined
    (as where noise decides whether it agrees), and each bound that is exceeded. Those in --known-misses do not fail;
    one of them that passes again is named too.

    \b
    Examples:
      mccd report --out report
      mccd report --out report --check
      mccd report --check --known-misses known-misses.toml --junit report.xml
      mccd report --out report --json > numbers.json
    """
    from campaigns.playing.campaign import load_campaign

    if not check and (known_misses or junit):
        raise click.UsageError(f"--{'known-misses' if known_misses else 'junit'} goes with --check")
    loaded, known = load_campaign(campaign), _known(known_misses)
    if dry_run:
        count_campaign(loaded, bench, seed, as_json=as_json)
        if own and {"rest", "sinesweep"} <= {run.plan for run in loaded.runs}:  # else none is designed
            say(f"mccd: not counted: the logs of the controller that is designed then, about {OWN_LOGS} (--no-design)")
        return 0
    folder = out or unnamed_folder(Path("report"))
    prepare_junit(junit, folder)

    # whoever made the folder may have put links in it
    logs, designed = unnamed_folder(folder / "campaign"), unnamed_folder(folder / "designed")
    if code := _play(loaded, logs, bench, seed, designed if own else None):
        return code

    from analysis.paper.measured import Measured
    from analysis.report import report_of

    with Measured(logs) as measured:
        if own and (code := _play_design(measured, designed, bench, seed, loaded.levels())):
            return code
        with progress("report") as advance:
            built = report_of(measured, folder, advance)
    emit(built.content(), as_json=as_json, text=_text(built), colours={"met": GOOD, "missed": BAD})
    if pdf:
        printed(built.page, folder / "report.pdf")
    return _checked(built, known, junit) if check else 0


def _known(file: Path | None) -> Known:
    """Return the known misses, before anything is played: a wrong name is refused at once."""
    if file is None:
        return {}
    from analysis.paper.known_misses import load_known_misses

    return load_known_misses(file)


def _play(campaign: Campaign, logs: Path, bench: str, seed: int, designed: Path | None) -> int:
    """Play a campaign, while the controller in `designed` is made of its first runs, if there is to be one."""
    if designed is None:
        return play_campaign(campaign, logs, bench, seed).exit_code
    then = f", and then about {OWN_LOGS} in {designed}"
    with DesignAhead(campaign, bench, seed, designed) as ahead:
        code = play_campaign(campaign, logs, bench, seed, then=then, complete=ahead.begin).exit_code
        if not code:
            ahead.finish()
    return code


def _play_design(measured: Measured, folder: Path, bench: str, seed: int, levels: Mapping[str, float]) -> int:
    """Design a controller from what a campaign measured, play it and add its logs; return an exit code.

    Its chops have the `levels` of the disturbance that the campaign's runs have.
    Nothing is done where the campaign does not hold what a design needs.
    """
    from contextlib import closing

    from analysis.design.from_logs import design_from_logs
    from campaigns.benches import open_bench
    from campaigns.playing.designed_campaign import designed_campaign

    with closing(open_bench(bench, seed)) as opened:
        limits, axes = opened.limits, opened.axes
    controller = design_from_logs(measured.runs, limits, axes, folder)
    if controller is None:
        return 0
    own = designed_campaign(controller, levels)
    played = play_campaign(own, folder, bench, seed)
    measured.add(folder)
    return played.exit_code


def _text(built: Report) -> str:
    from analysis.report.verdict import verdict_of

    rows = []
    for key, one in built.tables.items():
        oks = [row.ok for row in one.rows]
        kept = sum(row.ok is None and row.inside is True for row in one.rows)
        noisy = sum(row.noisy for row in one.rows)
        counts = oks.count(True), oks.count(False), kept, noisy, oks.count(None) - kept - noisy
        rows.append((key, *map(str, counts), one.paper.title))
    found = verdict_of(built.tables)
    missed = f"; missed: {', '.join(found.missed)}" if found.missed else ""
    met = f"\n\nrequirements met: {found.met} of {found.measured}{missed}" if found.measured else ""
    heads = ("table", "agree", "differ", "bound kept", "noise decides", "unknown", "")
    return f"{table(rows, heads=heads)}{met}\n\n{built.page}"


def _checked(built: Report, known: Known, junit: Path | None) -> int:
    """Tell every prediction outside its tolerance, and what has changed of those that are known; 1 for a new one."""
    from analysis.paper.known_misses import outcomes

    found = outcomes(built.tables, known)
    for one in found:
        where = f"{_where(one.table)}, {one.row}"
        if one.state in ("failed", "not measured"):
            say(f"mccd: check: {where}: {one.said}")
        elif one.state == "passes now":
            say(f"mccd: check: {where} passes now; remove it from the known misses")
    if junit is not None:
        cases = [
            Case(
                "",  # readers split a group at its dots, and the names of tables have one
                f"{one.table}: {one.row}",  # both as a list of known misses has them
                failure=one.said if one.state == "failed" else "",
                skipped=one.said if one.state in ("known miss", "not measured") else "",
            )
            for one in found
        ]
        write_junit(junit, "mccd report", cases)
    return 1 if any(one.state == "failed" for one in found) else 0


def _where(table: str) -> str:
    return "text" if table == "text" else f"table {table}"
