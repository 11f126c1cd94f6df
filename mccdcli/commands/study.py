"""`mccd study`: the same test many times, over drawn and swept models, strategies and settings."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from mccdcli.failures import INTERRUPTED
from mccdcli.options import WholeRange, common_options, existing_file
from mccdcli.output import emit, say, table
from mccdcli.progress import progress
from sim_backend.safe_write import unnamed_folder

if TYPE_CHECKING:
    from analysis.study.run import StudyOutcome
    from analysis.study.summary import Numbers, Point, Share
    from analysis.study.trial import Job


MOST_POINTS: Final = 12
MOST_REASONS: Final = 5
"""What is shown of a large study; its files contain all of it."""


class ClusterAddress(click.ParamType[str]):
    """The address of a scheduler: `tcp://HOST:PORT` or `tls://HOST:PORT`."""

    name = "cluster"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return `value` if it has the format of such an address, else end with a usage error."""
        address = str(value)
        if not re.fullmatch(r"(tcp|tls)://[^\s/]+:\d{1,5}", address):
            self.fail(f"{address!r} is not the address of a scheduler; write it as in tcp://127.0.0.1:8786", param, ctx)
        return address

    def risk_of(self, _value: Any) -> str:
        """Say what a default from somebody else's file would do."""
        return "programs on a cluster run what it sends"


@click.command()
@existing_file("study_file", metavar="STUDY.toml")
@click.option(
    "--workers", type=WholeRange(1, 256), metavar="N", help="Number of threads.  [default: one for each core]"
)
@click.option(
    "--cluster",
    type=ClusterAddress(),
    metavar="tcp://HOST:PORT",
    help="Scheduler of a dask.distributed cluster that runs the trials, instead of threads.",
)
@click.option("--resume", is_flag=True, help="Continue the study in the folder.")
@common_options("out", "dry_run", "json")
def study(
    study_file: Path,
    workers: int | None,
    cluster: str | None,
    resume: bool,
    out: Path | None,
    dry_run: bool,
    as_json: bool,
) -> int:
    """Try the same test many times, over drawn and swept models, strategies and settings.

    STUDY.toml says what a trial is, what varies and how often. Every finished trial is saved, in a folder with the
    study's name or in --out; after an interrupt, --resume continues. The results are the same bit for bit for any
    number of workers, in threads or on a cluster. A trial that fails is a result too and is counted. The exit code is 1
    if a trial met an error in mccd itself, or if all failed.

    \b
    Examples:
      mccd study study.toml --dry-run
      mccd study study.toml -o spread
      mccd study study.toml -o spread --resume --cluster tcp://127.0.0.1:8786
    """
    from analysis.study.definition import load_study
    from sim_backend.errors import ConfigError

    if workers is not None and cluster is not None:
        raise ConfigError("--workers counts threads, and a cluster has workers of its own; leave out one of the two")
    loaded = load_study(study_file)
    folder = out or unnamed_folder(Path(loaded.name))
    if dry_run:
        return _show(loaded, folder, as_json=as_json)

    from analysis.study.run import run_study

    try:
        with progress(loaded.title or loaded.name) as report:
            outcome = run_study(loaded, folder, workers=workers, address=cluster, resume=resume, report=report)
    except KeyboardInterrupt:
        say(f"mccd: what finished is saved in {folder}; --resume goes on")
        raise
    emit(_content(outcome, folder), as_json=as_json, text=_text(outcome, folder))
    if outcome.status == "paused":
        say(f"mccd: paused with {outcome.summary.finished} of {outcome.summary.total} trials; --resume goes on")
        return INTERRUPTED
    summary = outcome.summary
    return 1 if summary.broken or summary.failed == summary.total else 0


def _show(loaded: Any, folder: Path, *, as_json: bool) -> int:
    """Show what would be tried, checked as it would be, and try nothing."""
    from analysis.study.fingerprint import decided
    from analysis.study.trial import Job

    job = Job.of(loaded)
    decided(job)
    content = {
        "status": "dry run",
        "folder": folder,
        "name": loaded.name,
        "kind": loaded.kind,
        "total": loaded.total,
        "draws": loaded.trials,
        "points": [{"at": at} for at in loaded.points],
        "columns": job.columns,
        "varied": job.varied_names,
    }
    rows = [(name, _of_first(job, name)) for name in job.varied_names]
    parts = [table(rows, heads=("what varies", "in the first trial"))] if rows else []
    parts.append(f"{loaded.total} trials: {loaded.trials} draws at {len(loaded.points)} points; into {folder}")
    emit(content, as_json=as_json, text="\n\n".join(parts))
    return 0


def _of_first(job: Job, name: str) -> str:
    value = job.varied(0)[job.varied_names.index(name)]
    return f"{value:.8g}" if isinstance(value, float) else str(value)


def _content(outcome: StudyOutcome, folder: Path) -> dict[str, Any]:
    import json

    from sim_backend.small_files import TABLE_BYTES, read_small_text

    results = json.loads(read_small_text(outcome.files["json"], TABLE_BYTES))
    return {"status": outcome.status, "folder": folder, **results, "files": outcome.files, "timing": outcome.timing}


def _text(outcome: StudyOutcome, folder: Path) -> str:
    summary = outcome.summary
    parts = []
    for point in summary.points[:MOST_POINTS]:
        label = ", ".join(f"{place} = {value}" for place, value in point.at.items())
        rows = [(name, *_number(one)) for name, one in point.numbers.items()]
        rows += [(name, "", "", "", "", _share(one)) for name, one in point.flags.items()]
        rows += [
            (f"{name} {text}", "", "", "", "", _share(s)) for name, of in point.texts.items() for text, s in of.items()
        ]
        heads = (_ended(point), "5 %", "median", "95 %", "limit", "share, 95 % interval")
        parts.append("\n".join([*([label] if label else []), table(rows, heads=heads)]))
    if len(summary.points) > MOST_POINTS:
        parts.append(f"and {len(summary.points) - MOST_POINTS} points more in {outcome.files['json']}")
    for one in summary.reasons[:MOST_REASONS]:
        parts.append(f"{one.trials} {one.status}, first trial {one.first}: {one.reason}")
    timing = outcome.timing
    now = (
        f"{timing.trials} trials in {timing.wall_s:.1f} s, {timing.trial_s * 1e3:.1f} ms each; "
        if timing.trials
        else ""
    )
    parts.append(f"{now}{', '.join(str(path) for path in outcome.files.values())}")
    return "\n\n".join(parts)


def _ended(point: Point) -> str:
    lost = [f"{n} {what}" for n, what in ((point.failed, "failed"), (point.broken, "broken")) if n]
    return ", ".join([f"{point.done} done", *lost])


def _number(one: Numbers) -> tuple[str, ...]:
    from analysis.pages.formats import readable

    limit = "" if one.limit is None else readable(one.limit, 4)
    return (*(readable(q, 4) for q in one.quantiles.values()), limit, "" if one.within is None else _share(one.within))


def _share(one: Share) -> str:
    return f"{one.hits} of {one.of}, {100 * one.ci95[0]:.1f} to {100 * one.ci95[1]:.1f} %" if one.of else "none"
