"""`mccd endstops`: noise of the position sensors against the end stops."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from mccdcli.options import common_options
from mccdcli.trials import conclude, count, play, settings_option


@click.command()
@settings_option
@common_options()
def endstops(bench: str, out: Path | None, seed: int, dry_run: bool, as_json: bool, settings: dict[str, Any]) -> int:
    """Pull the mechanism against its end stops, eight ways, and measure the noise of the sensors there.

    The log is endstops.h5 unless --out names another. Exit code 1 if a 3σ exceeds 30 nm.

    \b
    Examples:
      mccd endstops --out endstops.h5
      mccd endstops --set current_a=5.0 --dry-run
    """
    from campaigns.plans import make_plan

    plan = make_plan("endstops", settings)
    if dry_run:
        count({plan.name: plan}, bench, seed, as_json=as_json)
        return 0
    played = play(plan, bench, out or Path("endstops.h5"), seed)
    if played.exit_code:
        return played.exit_code

    from analysis.recorded.requirements import endstop_checks
    from analysis.recorded.sensors import endstops_of
    from campaigns.log import read_run

    with read_run(played.log) as run:
        test = endstops_of(run)
    return conclude("end stops", endstop_checks(test), {"result": test}, [played.log], as_json=as_json)
