"""`mccd diagnose`: what a simulation gets wrong, why, and what correcting it gains."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click
from click.core import ParameterSource

from mccdcli.idle_options import refuse_typed
from mccdcli.junit import Case, prepare_junit, write_junit
from mccdcli.options import FRF_HELP, BenchAddress, NewPath, Percent, Real, WholeRange, common_options, without_option
from mccdcli.output import VERDICTS, emit, say, table
from mccdcli.pdf import pdf_option, printed
from mccdcli.progress import progress
from sim_backend.safe_write import unnamed_folder

if TYPE_CHECKING:
    from analysis.diagnosis.evidence.chop_gain import ChopGain
    from analysis.diagnosis.experiment.planned import BenchDescription
    from analysis.diagnosis.records.loading import Source
    from analysis.diagnosis.result import Diagnosis
    from sim_backend.model import Model


POSSIBLE: Final = ("consistent", "named", "ambiguous", "unknown")
"""Verdicts."""


@click.command()
@click.argument("runs", nargs=-1, type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="RUN.h5…")
@click.option("--model", "nominal", required=True, metavar="MODEL", help="Model to judge: a file or a bundled one.")
@without_option
@click.option(
    "--nominal-tolerance",
    type=Percent(0, 100, min_open=True),
    default="3%",
    show_default=True,
    help="Relative standard deviation of the model's own parameters, e.g. 3%.",
)
@click.option(
    "--rows",
    type=WholeRange(min=1000),
    default=250_000,
    show_default=True,
    help="Largest number of samples to use, all logs together; memory and time grow with it.",
)
@click.option(
    "--bench",
    type=BenchAddress(),
    metavar="BENCH",
    help="Propose an experiment that this bench can do, and compare chops on it with the feed-forward of each model.",
)
@click.option(
    "--frf",
    "table_file",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help=FRF_HELP,
)
@click.option(
    "--level", type=Real(), help="With --frf: level of excitation to use, in the unit of its column.  [default: all]"
)
@click.option(
    "--held",
    is_flag=True,
    help="With --frf: the table was sampled at the model's rate, its input held between samples.",
)
@click.option("--page/--no-page", default=True, show_default=True, help="Draw the page index.html and its figures.")
@pdf_option("diagnosis.pdf")
@click.option(
    "--expect",
    type=click.Choice(POSSIBLE),
    default="consistent",
    show_default=True,
    help="Verdict that gives exit code 0; any other gives 1. Where it is given, the reason of a 1 is printed too.",
)
@click.option(
    "--junit",
    type=NewPath(dir_okay=False),
    metavar="FILE",
    help="Also write the verdict as a case of a JUnit file, which CI shows.",
)
@common_options("out", "seed", "json")
def diagnose(
    runs: tuple[Path, ...],
    table_file: Path | None,
    level: float | None,
    held: bool,
    out: Path | None,
    seed: int,
    as_json: bool,
    nominal: str,
    without: tuple[str, ...],
    nominal_tolerance: float,
    rows: int,
    bench: str | None,
    page: bool,
    pdf: bool,
    expect: str,
    junit: Path | None,
) -> int:
    """Compare logs with a model: is it right, what is it missing, how sure is that, and what does adding it gain?

    There are four verdicts. consistent: what the model misses is noise. named: the model is wrong, and the causes are
    listed. ambiguous: it is wrong, and these data do not show which of the tied causes it is. unknown: it is wrong,
    and no effect in the library explains how.

    Writes diagnosis.json, extended.toml (the model with what was found), index.html and figures into the folder
    diagnosis, or into --out. Where causes are tied, it proposes an experiment that separates them. A log of the plan
    theodolite may be among RUN.h5; it can decide where the sensors alone cannot. The exit code is 0 when the verdict is
    that of --expect (without it: consistent), else 1.

    \b
    Examples:
      mccd diagnose RUN.h5 --model nominal.toml -o OUT/
      mccd diagnose FREE.h5 CHOP.h5 --model nominal.toml --without hysteresis --json
      mccd diagnose NIGHT.h5 --model nominal.toml --expect consistent --junit diagnosis.xml
      mccd diagnose --frf response.csv --model nominal.toml -o OUT/
    """
    from sim_backend.model import load_model

    _require_one(runs, table_file, bench, level, held=held)
    if pdf and not page:
        raise click.UsageError("--pdf is the page on paper: leave out --no-page")
    folder = out or unnamed_folder(Path("diagnosis"))
    prepare_junit(junit, folder)
    model = load_model(nominal)  # before what diagnoses is imported: a wrong name is refused at once
    settings = {"tolerance": nominal_tolerance, "without": without, "seed": seed}
    if table_file is not None:
        found = _of_table(table_file, model, folder, settings, level, held=held, page=page, as_json=as_json)
    else:
        found = _of_logs(runs, nominal, model, folder, settings, rows, bench, page=page, as_json=as_json)
    if pdf:
        printed(folder / "index.html", folder / "diagnosis.pdf")
    return _concluded(found, nominal, expect, junit)


def _of_logs(
    runs: tuple[Path, ...],
    nominal: str,
    model: Model,
    out: Path,
    settings: dict[str, Any],
    rows: int,
    bench: str | None,
    *,
    page: bool,
    as_json: bool,
) -> dict[str, Any]:
    """Judge the model by logs, write the files, chop on a bench where one is named, and show the answer."""
    from dataclasses import replace

    from analysis.diagnosis.answer.output import document, prepare_folder, write_files
    from analysis.diagnosis.experiment.reference_sensor import load_logs
    from analysis.diagnosis.pipeline import Options
    from analysis.diagnosis.pipeline import diagnose as judge
    from sim_backend.memory import keep_long_arrays

    keep_long_arrays()
    folder = prepare_folder(out)
    loaded, references = load_logs(runs, model, max_rows=rows)
    with progress("diagnosing") as report:
        found = judge(
            loaded.data,
            model,
            Options(**settings),
            progress=lambda what, part: report(part, 1.0, what),
            bench=None if bench is None else _description(bench, settings["seed"]),
            references=references,
        )
    found = replace(found, notes=(*loaded.notes, *found.notes))
    files = write_files(found, model, loaded.sources, folder)
    chops: tuple[ChopGain, ...] = ()
    try:
        if bench is not None:
            # the diagnosis is safe by then, whatever the bench does
            chops, why = _chops(bench, settings["seed"], nominal, files["extended.toml"], model)
            found = replace(found, notes=(*found.notes, *why))
            files = write_files(found, model, loaded.sources, folder, chops)
    finally:  # once: drawing takes as long as judging
        drawn = _page(found, model, loaded.sources, folder, chops) if page else {}
    files = drawn | files
    content = document(found, model, loaded.sources, chops)
    emit(content, as_json=as_json, text=_text(content, files), colours=VERDICTS)
    return content


def _page(
    found: Diagnosis, model: Model, sources: Sequence[Source], folder: Path, chops: Sequence[ChopGain]
) -> dict[str, Path]:
    from analysis.diagnosis.answer.page import write_page

    return write_page(found, model, sources, folder, chops)


def _concluded(found: dict[str, Any], nominal: str, wanted: str, junit: Path | None) -> int:
    """Hold the verdict against the one that is expected; return 1 where it is another, and say why if one was given."""
    met = found["verdict"] == wanted
    why = "" if met else f"the verdict on {nominal} is {found['verdict']}, not {wanted}. {found['sentence']}"
    source = click.get_current_context().get_parameter_source("expect")
    if not met and source is not ParameterSource.DEFAULT:
        say(f"mccd: check: {why}")
    if junit is not None:
        name = f"{wanted} with {', '.join(Path(one['file']).name for one in found['inputs'])}"
        write_junit(junit, "mccd diagnose", [Case(Path(nominal).stem, name, failure=why)])
    return 0 if met else 1


def _require_one(
    runs: tuple[Path, ...], table_file: Path | None, bench: str | None, level: float | None, *, held: bool
) -> None:
    """End with a usage error unless logs or a table are given, and what goes with them."""
    if runs and table_file is not None:
        raise click.UsageError("give logs or a frequency-response table, not both")
    if table_file is not None and bench is not None:
        raise click.UsageError("--bench goes with logs: a table proposes no experiment")
    if table_file is not None:
        refuse_typed(("rows",), "goes with logs: of a table all points are used")
    if table_file is None and (level is not None or held):
        raise click.UsageError(f"--{'held' if held else 'level'} goes with --frf")
    if not runs and table_file is None:
        raise click.UsageError("Missing argument 'RUN.h5…': give logs, or a frequency-response table with --frf.")


def _of_table(
    file: Path,
    model: Model,
    out: Path,
    settings: dict[str, Any],
    level: float | None,
    *,
    held: bool,
    page: bool,
    as_json: bool,
) -> dict[str, Any]:
    """Judge the model by a frequency-response table, write the files and show the answer."""
    from analysis.diagnosis.answer.output import document, prepare_folder, write_files
    from analysis.diagnosis.pipeline import Options
    from analysis.diagnosis.records.loading import Source
    from analysis.diagnosis.response.diagnose import diagnose_response
    from analysis.diagnosis.response.lines import load_lines
    from analysis.diagnosis.response.page import write_response_page
    from campaigns.log import sha256_of

    options = Options(**settings)
    folder = prepare_folder(out)
    lines = load_lines(file, model, level=level)
    sources = [Source(str(file), sha256_of(file), file.name, lines.n)]
    with progress("diagnosing") as report:
        found, drawn = diagnose_response(
            lines, model, file, options, held=held, progress=lambda what, part: report(part, 1.0, what)
        )
    pages = write_response_page(found, drawn, model, sources, folder) if page else {}
    files = pages | write_files(found, model, sources, folder)
    content = document(found, model, sources)
    emit(content, as_json=as_json, text=_text(content, files), colours=VERDICTS)
    return content


def _chops(
    bench: str, seed: int, nominal: str, extended: Path, model: Model
) -> tuple[tuple[ChopGain, ...], tuple[str, ...]]:
    """Return what the corrected model gains in chopping on a bench, or why that was not measured."""
    from analysis.diagnosis.evidence.chop_gain import chops_or_why
    from campaigns.benches import open_bench

    return chops_or_why(lambda: open_bench(bench, seed), nominal, extended, model, seed)


def _description(bench: str, seed: int) -> BenchDescription:
    """What a bench may be asked: its own limits bound the next experiment."""
    from contextlib import closing

    from analysis.diagnosis.experiment.planned import BenchDescription
    from campaigns.benches import open_bench

    with closing(open_bench(bench, seed)) as opened:
        return BenchDescription.of(opened)


def _text(found: dict[str, Any], files: dict[str, Path]) -> str:
    from analysis.pages.formats import without_exponents
    from analysis.pages.quantities import certainty

    parts = [found["sentence"]]
    causes = [
        (
            c["effect"],
            c["where"],
            certainty(c["probability"]),
            ", ".join(_parameter(n, p) for n, p in c["parameters"].items()),
        )
        for c in found["causes"]
    ]
    if causes:
        parts.append(table(causes, heads=("cause", "where", "probability", "parameters")))
    parts += ["tied: " + " or ".join(tied) for tied in found["ambiguous"]]
    parts += map(without_exponents, found["notes"])
    parts += [f"next: {step}" for step in found["next_steps"]]
    named = ("index.html", "diagnosis.json", "extended.toml")
    parts.append(", ".join(str(files[name]) for name in named if name in files))
    return "\n\n".join(parts)


def _parameter(name: str, estimate: dict[str, Any]) -> str:
    from analysis.pages.formats import known_exactly, readable

    unit = "" if estimate["unit"] == "1" else f" {estimate['unit']}"
    value, std = estimate["value"], estimate["std"]
    spread = "" if std is None or known_exactly(value, std) else f" ± {readable(std, 2)}"
    return f"{name} {readable(value, 5)}{spread}{unit}"
