"""`mccd log verify`: is a log as it was written?"""

from __future__ import annotations

from pathlib import Path

import click

from mccdcli.options import common_options, existing_file
from mccdcli.output import emit, plain, table


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

    reports = [verify_log(run) for run in runs]
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
    )
    return 0 if ok else 1
