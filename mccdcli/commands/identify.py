"""`mccd identify`: a linear model from a stepped sine, or from any logs."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mccdcli.idle_options import refuse_typed
from mccdcli.options import FRF_HELP, POSITIVE, NewPath, Real, WholeRange, common_options
from mccdcli.output import emit, say, table
from mccdcli.progress import progress
from mccdcli.trials import count_campaign, play_campaign, settings_option

if TYPE_CHECKING:
    from analysis.identification.identified import Identification
    from campaigns.log import Run

PAGE = ".html"
"""Ending of a picture that is a page."""

OF_SWEEPS = ("bench", "axes", "folder", "settings", "seed", "dry_run", "note")
OF_LOGS = ("only", "equal_weights")
OF_TABLE = ("rate_hz", "level")
"""Options that have an effect with one kind of data alone."""


@click.command()
@click.option(
    "--log",
    "given",
    multiple=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="RUN.h5",
    help="Log to read: the model is identified from it, and nothing is played; repeatable.",
)
@click.option("--axis", "axes", multiple=True, metavar="AXIS", help="Axis to sweep; repeatable.  [default: all]")
@click.option(
    "--logs",
    "folder",
    type=NewPath(),
    metavar="DIR",
    help="Folder to write the logs of the sweeps to.  [default: NAME.runs beside the model NAME.toml]",
)
@click.option(
    "--modes",
    type=WholeRange(min=1),
    metavar="N",
    help="Number of modes; that of each axis where stepped sines are fitted.  [default: chosen from the data]",
)
@click.option(
    "--only",
    default="",
    metavar="TEXT",
    help="With --log: fit only segments whose label contains TEXT; all held-out ones are tested. Not of stepped sines.",
)
@click.option(
    "--equal-weights",
    is_flag=True,
    help="With --log: weight all frequency bins of a periodic record alike, for the least rms error where distortion "
    "limits the fit.",
)
@click.option(
    "--response",
    type=NewPath(dir_okay=False),
    metavar="FILE",
    help="Also write the measured frequency response: .csv with its uncertainty, or .sNp (Touchstone-like).",
)
@click.option(
    "--frf",
    "table_file",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help=FRF_HELP,
)
@click.option(
    "--rate",
    "rate_hz",
    type=POSITIVE,
    metavar="HZ",
    help="With --frf: sample rate of the model.  [default: 10 times the highest frequency]",
)
@click.option(
    "--level",
    type=Real(),
    help="With --frf: level of excitation to fit, in the unit of its column.  [default: the lowest]",
)
@click.option(
    "--plot",
    "picture",
    type=NewPath(dir_okay=False),
    metavar="FILE",
    help="Also draw a Bode plot of data and model: .png, .svg or .pdf; as .html a page with all numbers.",
)
@click.option(
    "--force", is_flag=True, help="Replace an existing model, and picture of --plot; --response never replaces a file."
)
@settings_option
@common_options()
def identify(
    bench: str,
    out: Path | None,
    seed: int,
    dry_run: bool,
    as_json: bool,
    settings: dict[str, Any],
    given: tuple[Path, ...],
    axes: tuple[str, ...],
    folder: Path | None,
    modes: int | None,
    only: str,
    equal_weights: bool,
    response: Path | None,
    table_file: Path | None,
    rate_hz: float | None,
    level: float | None,
    picture: Path | None,
    force: bool,
) -> int:
    """Sweep every axis with a stepped sine and fit a linear model, or fit one to the logs of any bench.

    The model is nominal.toml unless --out names another. With --log or --frf nothing is played, and options of the
    sweeps are refused. After an interrupt the same command continues the sweeps.

    \b
    Examples:
      mccd identify --out nominal.toml
      mccd identify --log RUN.h5 --log OTHER.h5 --modes 3 -o nominal.toml
      mccd identify --log RUN.h5 --only "200 mV" --modes 14 --equal-weights -o nominal.toml
      mccd identify --log RUN.h5 --response response.csv -o nominal.toml
      mccd identify --log RUN.h5 --plot bode.png -o nominal.toml
      mccd identify --log RUN.h5 --plot nominal.html -o nominal.toml
      mccd identify --frf response.csv --rate 5000 -o nominal.toml
    """
    from mccdcli.models import refuse_existing

    if table_file is not None and given:
        raise click.UsageError("give logs or a frequency-response table, not both")
    _refuse_idle(given, table_file, dry_run=dry_run, of_logs=bool(only) or equal_weights)
    target = out or Path("nominal.toml")
    refuse_existing(target, force=force)
    if picture is not None:
        _require_picture(picture, force=force)
    if table_file is not None:
        fitted = _from_table(table_file, modes=modes, rate_hz=rate_hz, level=level, name=target.stem)
        return _done(fitted, (), target, (table_file,), response, picture, as_json, force=force)
    if dry_run:
        return _counted(bench, axes, settings, seed, as_json)
    logs = given or _swept(bench, axes, settings, folder or target.with_suffix(".runs"), seed)
    if isinstance(logs, int):
        return logs
    from campaigns.log import read_run

    with ExitStack() as stack:
        runs = [stack.enter_context(read_run(log)) for log in logs]
        found = _from_logs(runs, modes=modes, only=only, equal_weights=equal_weights, name=target.stem)
        return _done(found, runs, target, logs, response, picture, as_json, force=force)


def _refuse_idle(logs: Sequence[Path], table_file: Path | None, *, dry_run: bool, of_logs: bool) -> None:
    """End with a usage error for options without effect on the data that are fitted.

    A dry run must not write, and sweeps must not be played before the fit is refused, whatever set the option.
    """
    if logs or table_file:
        source = "--frf" if table_file else "--log"
        refuse_typed(OF_SWEEPS, f"goes with sweeps, and {source} plays none; leave out one of the two")
        if dry_run:
            raise click.UsageError(f"--dry-run counts sweeps, and {source} plays none; leave out one of the two")
    if not logs:
        refuse_typed(OF_LOGS, "goes with --log")
        if of_logs and not table_file:
            raise click.UsageError("--only and --equal-weights go with --log: stepped sines are fitted whole")
    if not table_file:
        refuse_typed(OF_TABLE, "goes with --frf")


def _require_picture(path: Path, *, force: bool) -> None:
    if path.suffix.lower() == PAGE:
        from analysis.identification.page import require_page

        require_page(path)
        return
    from campaigns.log.plot import require_picture

    require_picture(path, force=force)


def _counted(bench: str, axes: tuple[str, ...], settings: dict[str, Any], seed: int, as_json: bool) -> int:
    from campaigns.playing.sweep_campaign import sweep_campaign

    count_campaign(sweep_campaign(bench, axes, settings), bench, seed, as_json=as_json)
    return 0


def _from_table(file: Path, **settings: Any) -> Identification:
    from analysis.identification.from_table import identify_table

    with progress("identifying") as report:
        return identify_table(file, **settings, report=report)


def _from_logs(runs: Sequence[Run], **settings: Any) -> Identification:
    from analysis.identification.identify import identify_runs

    with progress("identifying", timed=False) as report:
        return identify_runs(runs, **settings, report=report, tell=lambda remark: say(f"remark: {remark}"))


def _swept(
    bench: str, axes: tuple[str, ...], settings: dict[str, Any], folder: Path, seed: int
) -> tuple[Path, ...] | int:
    """Return the logs of the sweeps, played now or found in the folder; the exit code where they were stopped."""
    from campaigns.playing.sweep_campaign import sweep_campaign

    played = play_campaign(sweep_campaign(bench, axes, settings), folder, bench, seed)
    return played.exit_code or tuple(played.logs.values())


def _done(
    found: Identification,
    runs: Sequence[Run],
    target: Path,
    sources: tuple[Path, ...],
    response: Path | None,
    picture: Path | None,
    as_json: bool,
    *,
    force: bool,
) -> int:
    """Write the model, then response and picture or page where they are wanted, and show it."""
    from analysis.identification.response_files import save_response
    from mccdcli.models import save_model

    save_model(found.model, target, force=force)
    if response is not None:
        save_response(found.response, response)
    if picture is not None and picture.suffix.lower() == PAGE:
        from analysis.identification.page import write_page

        write_page(found, runs, sources, picture)
    elif picture is not None:
        from analysis.identification.bode import save_bode

        save_bode(found, runs, picture)
    text = f"{_text(found)}\n\nmodel: {target}; from {', '.join(map(str, sources))}"
    emit({"model": target, "logs": list(sources), "identification": found}, as_json=as_json, text=text)
    return 0


def _text(found: Identification) -> str:
    from analysis.identification.summary import HEADS, facts, modes_table

    remarks = "".join(f"\nremark: {remark}" for remark in found.remarks)
    return f"{table(modes_table(found), heads=HEADS)}\n\n{table(facts(found))}{remarks}"
