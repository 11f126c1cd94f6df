"""`mccd log check`: what is known of a record before it is used."""

from __future__ import annotations

from pathlib import Path

import click

from mccdcli.options import common_options, existing_file
from mccdcli.output import emit, table


@click.command()
@existing_file("run")
@common_options("json")
def check(run: Path, as_json: bool) -> int:
    """Check what a log shows about itself: sizes, units, periods, dead channels, slow sensors, steps, clipping.

    Checks inputs and outputs together for transients, clocks that differ, a closed loop, delays and coherence, and says
    what each finding means for identify and diagnose.

    The exit code is 1 when identify and diagnose refuse the log.

    \b
    Examples:
      mccd log check RUN.h5
      mccd log check RUN.h5 --json
    """
    from campaigns.facts import all_facts_of, missing_in
    from campaigns.facts.bands import bands_text
    from campaigns.log import read_run

    with read_run(run) as log:
        facts, anew, uid = all_facts_of(log), missing_in(log), log.run_uid
    forbidden = any(fact.forbids for fact in facts)
    rows = []
    for fact in facts:
        rows.append((fact.name, fact.finding, ("FORBIDS: " if fact.forbids else "") + fact.means))
        rows += [("", bands_text(fact.bands), "")] if fact.bands else []
    text = table(rows, heads=("fact", "finding", "what it means"))
    if anew:
        text += f"\n\nfound just now, for the log does not hold them: {', '.join(anew)}"
    told = {"file": run, "run_uid": uid, "usable": not forbidden, "facts": list(facts), "found_anew": list(anew)}
    emit(told, as_json=as_json, text=text)
    return 1 if forbidden else 0
