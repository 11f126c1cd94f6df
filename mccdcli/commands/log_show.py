"""`mccd log show`: what a log holds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mccdcli.logtext import channels_text, length_text, segments_text
from mccdcli.options import common_options, existing_file
from mccdcli.output import emit, plain, table

if TYPE_CHECKING:
    from campaigns.facts.sizes import Sizes
    from campaigns.log import Run


@click.command()
@existing_file("run")
@common_options("json")
def show(run: Path, as_json: bool) -> None:
    """Show what a log holds: its run, its channels with their sizes, its segments.

    Sizes are smallest value, largest value and rms about the mean; a wrong unit is seen there. Facts that an import has
    left in the log are listed; `mccd log check` finds those of any log.

    \b
    Examples:
      mccd log show RUN.h5
      mccd log show RUN.h5 --json
    """
    from campaigns.facts import sizes_of
    from campaigns.log import read_run

    with read_run(run) as log:
        sizes = sizes_of(log)
        emit(_described(log, sizes), as_json=as_json, text=_text(log, sizes))


def _described(log: Run, sizes: Sizes) -> dict[str, Any]:
    from campaigns.facts import stored_facts

    return {
        "file": log.path,
        **plain(log.header),
        "rows": log.rows,
        "sample_rate_hz": log.sample_rate_hz,
        "channels": list(log.channels.values()),
        "segments": [{**plain(segment), "held_out": segment.held_out} for segment in log.segments],
        "sizes": sizes.by_channel,
        "sized_samples": sizes.samples,
        "unknown_sizes": sizes.unknown,
        "facts": list(stored_facts(log)),
    }


def _text(log: Run, sizes: Sizes) -> str:
    from campaigns.facts import stored_facts

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
    told = [(fact.name, fact.finding) for fact in stored_facts(log) if fact.name != "size"]  # it is in the table
    parts = [
        table(facts),
        channels_text(log.channels.values(), sizes.by_channel),
        *_remarks_on(sizes, log.rows),
        segments_text(log.segments),
        *([table(told, heads=("fact", "finding"))] if told else []),
    ]
    return "\n\n".join(parts)


def _remarks_on(sizes: Sizes, rows: int) -> list[str]:
    remarks = [f"no size of {name}: {why}" for name, why in sizes.unknown.items()]
    if sizes.samples < rows:
        remarks.append(f"sizes are of the first {sizes.samples} samples: mccd log summary reads all")
    return ["\n".join(remarks)] if remarks else []
