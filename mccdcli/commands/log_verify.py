"""`mccd log verify`: is a log as it was written?"""

from __future__ import annotations

from itertools import accumulate
from pathlib import Path

import click

from mccdcli.options import common_options, existing_file
from mccdcli.output import BAD, GOOD, emit, plain, table
from mccdcli.progress import progress


@click.command()
@existing_file("runs", nargs=-1)
@common_options("json")
def verify(runs: tuple[Path, ...], as_json: bool) -> int:
    """Verify that logs are as they were written; exit code 1 if one is not.

    \b
    Examples:
      mccd log verify RUN.h5
      mccd log verify runs/*.h5 --json
    """
    from campaigns.log import verify as verify_log
    from campaigns.progress import part_of

    # by the bytes of each, which is what takes the time
    ends = list(accumulate((max(run.stat().st_size, 1) for run in runs), initial=0))
    with progress("verifying") as report:
        reports = [
            verify_log(run, part_of(report, start / ends[-1], stop / ends[-1]))
            for run, start, stop in zip(runs, ends[:-1], ends[1:], strict=True)
        ]
    rows = [
        (str(report.path), "ok" if check.ok else "FAILED", check.name, check.detail)
        for report in reports
        for check in report.checks
    ]
    ok = all(report.ok for report in reports)
    emit(
        {"ok": ok, "runs": [{**plain(report), "ok": report.ok} for report in reports]},
        as_json=as_json,
        text=table(rows),
        colours={"ok": GOOD, "FAILED": BAD},
    )
    return 0 if ok else 1
