"""`mccd log show`: what a log holds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mccdcli.logtext import channels_text, length_text, segments_text
from mccdcli.options import common_options, existing_file
from mccdcli.output import emit, plain, table

if TYPE_CHECKING:
    from campaigns.log import Run


@click.command()
@existing_file("run")
@common_options("json")
def show(run: Path, as_json: bool) -> None:
    """Show what a log holds: its run, its channels and its segments.

    \b
    Examples:
      mccd log show RUN.h5
      mccd log show RUN.h5 --json
    """
    from campaigns.log import read_run

    with read_run(run) as log:
        emit(_described(log), as_json=as_json, text=_text(log))


def _described(log: Run) -> dict[str, Any]:
    return {
        "file": log.path,
        **plain(log.header),
        "rows": log.rows,
        "sample_rate_hz": log.sample_rate_hz,
        "channels": list(log.channels.values()),
        "segments": [{**plain(segment), "held_out": segment.held_out} for segment in log.segments],
    }


def _text(log: Run) -> str:
    header = log.header
    reason = f" ({header.status_reason})" if header.status_reason else ""
    facts = [
        ("run", log.run_uid),
        ("test", header.test),
        ("status", header.status + reason),
        ("started", header.started_utc),
        ("bench", ", ".join(f"{key} {value}" for key, value in header.bench.items())),
        ("written by", f"mccd {header.tool_version} (commit {header.tool_commit})"),
        *([("note", header.note)] if header.note else []),
        ("seed", "none" if header.seed is None else str(header.seed)),
        ("length", length_text(log.rows, log.sample_rate_hz)),
    ]
    from campaigns.facts import stored_facts

    sizes = {fact.channel: fact.numbers for fact in stored_facts(log) if fact.name == "size"}
    return "\n\n".join([table(facts), channels_text(log.channels.values(), sizes), segments_text(log.segments)])
