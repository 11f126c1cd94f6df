"""`mccd hysteresis`: loops at several amplitudes and steps at several offsets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from mccdcli.options import common_options
from mccdcli.trials import conclude, count, play, settings_option


@click.command()
@click.option("--axis", default="theta_x", show_default=True, help="Axis to drive.")
@click.option("--fit/--no-fit", default=True, show_default=True, help="Fit Jiles–Atherton and polynomial to the loops.")
@settings_option
@common_options()
def hysteresis(
    bench: str,
    out: Path | None,
    seed: int,
    dry_run: bool,
    as_json: bool,
    settings: dict[str, Any],
    axis: str,
    fit: bool,
) -> int:
    """Drive slow sine loops and fed-forward steps at offsets, open loop, and measure the hysteresis.

    The log is hysteresis.h5 unless --out names another.

    \b
    Examples:
      mccd hysteresis --axis theta_y --out hysteresis-y.h5
      mccd hysteresis --set 'torques_nm=[0.05, 0.08]' --no-fit
    """
    from campaigns.plans import make_plan

    plan = make_plan("hysteresis", {"axis": axis, **settings})
    if dry_run:
        count({plan.name: plan}, bench, seed, as_json=as_json)
        return 0
    played = play(plan, bench, out or Path("hysteresis.h5"), seed)
    if played.exit_code:
        return played.exit_code

    from analysis.recorded.hysteresis import loops_of, steps_of
    from analysis.recorded.loop_fit import loop_fit_of
    from analysis.recorded.requirements import hysteresis_checks
    from campaigns.log import read_run

    with read_run(played.log) as run:
        loops, steps = loops_of(run), steps_of(run)
        fitted = loop_fit_of(run) if fit else None
    results = {"loops": loops, "steps": steps, "fit": fitted}
    return conclude(f"hysteresis {axis}", hysteresis_checks(loops), results, [played.log], as_json=as_json)
