"""`mccd log list`: the logs of a folder."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mccdcli.options import common_options
from mccdcli.output import emit, plain, table
from mccdcli.progress import progress

if TYPE_CHECKING:
    from campaigns.log.listing import Listed

STATUSES = ("running", "complete", "paused", "aborted", "failed", "crashed", "unreadable")


class Since(click.ParamType[datetime]):
    """A date or a time in ISO 8601; without a zone it is UTC, as in the list."""

    name = "date"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> datetime:
        """Return the time with its zone, else end with a usage error."""
        if isinstance(value, datetime):
            return value
        try:
            time = datetime.fromisoformat(str(value))
        except ValueError:
            self.fail(f"{value!r} is not a date; write it as in 2026-03-01 or 2026-03-01T12:00:00+01:00", param, ctx)
        return time if time.tzinfo else time.replace(tzinfo=UTC)


@click.command("list")
@click.argument("folder", metavar="DIR", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--test", default="", metavar="TEXT", help="Only logs whose test contains TEXT.")
@click.option("--bench", "of_bench", default="", metavar="TEXT", help="Only logs whose bench contains TEXT.")
@click.option("--note", default="", metavar="TEXT", help="Only logs whose note contains TEXT.")
@click.option("--status", type=click.Choice(STATUSES), help="Only logs of this status.")
@click.option("--since", type=Since(), metavar="DATE", help="Only logs that were started on DATE or later (UTC).")
@common_options("json")
def list_logs(
    folder: Path, test: str, of_bench: str, note: str, status: str | None, since: datetime | None, as_json: bool
) -> None:
    """List the logs in DIR and below: test, bench, start, status, note.

    Only headers are read. Files that are damaged, or not logs, are listed as such, whatever --test, --bench, --note and
    --since say; --status leaves them out, and --status unreadable lists them alone.

    \b
    Examples:
      mccd log list runs
      mccd log list runs --test chop --since 2026-03-01
      mccd log list . --status failed --json
    """
    from campaigns.log.listing import Wanted
    from campaigns.log.listing import list_logs as listed

    with progress("reading headers") as report:
        found = listed(folder, Wanted(test, of_bench, note, status or "", since), report)
    rows = [_row(one, folder) for one in found]
    text = table(rows, heads=("log", "test", "bench", "started (UTC)", "status", "note")) if rows else _none(folder)
    emit({"folder": folder, "logs": [plain(one) for one in found]}, as_json=as_json, text=text)


def _row(one: Listed, folder: Path) -> tuple[str, ...]:
    name = str(one.path.relative_to(folder)) if one.path.is_relative_to(folder) else str(one.path)
    if one.error:
        return (name, "", "", "", one.status, " ".join(one.error.split()))
    started = datetime.fromisoformat(one.started_utc).astimezone(UTC).strftime("%Y-%m-%d %H:%M:%S")
    return (name, one.test, one.bench_text, started, one.status, one.note)


def _none(folder: Path) -> str:
    return f"{folder} holds no log that was asked for (a log is a file whose name ends in .h5)"
