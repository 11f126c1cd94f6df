"""`mccd chop`: positional stability of a chop."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from mccdcli.options import Real, WholeRange, common_options
from mccdcli.trials import Form, conclude, controller_option, count, play, settings_option


@click.command()
@click.option("--alpha", type=Real(), default=0.0, show_default=True, help="Direction in degrees: 0 is θx, 90 is θy.")
@click.option("--form", type=Form(), default="0:+8.5", show_default=True, help="Both positions in mrad.")
@click.option("--strategy", default="hybrid", show_default=True, help="Control strategy.")
@click.option("--cycles", type=WholeRange(1), default=15, show_default=True, help="Cycles to chop.")
@click.option("--frequency", type=Real(), default=0.5, show_default=True, help="Chop frequency in Hz.")
@click.option("--model", default="design-4th-order", show_default=True, help="Design model: a bundled one or a file.")
@controller_option
@settings_option
@common_options()
def chop(
    bench: str,
    out: Path | None,
    seed: int,
    dry_run: bool,
    as_json: bool,
    settings: dict[str, Any],
    alpha: float,
    form: tuple[float, float],
    strategy: str,
    cycles: int,
    frequency: float,
    model: str,
    controller: str | None,
) -> int:
    """Chop between two positions and measure stability, repeatability and accuracy in both directions.

    The log is chop.h5 unless --out names another. Exit code 1 if a requirement of Table 6.6 is missed.

    \b
    Examples:
      mccd chop --alpha 120 --form 0:+8.5 --out chop-120.h5
      mccd chop --form=-8.5:+8.5 --strategy mbff --json
    """
    from mccdcli.own_controller import chop_plan, told_to_design_anew

    chosen = {"strategy": strategy, "alpha_deg": alpha, "from_rad": form[0], "to_rad": form[1], "cycles": cycles}
    chosen |= {"frequency_hz": frequency, "model": model, "controller": controller}
    plan = chop_plan("chop", {**chosen, **settings}, bench, seed, dry_run=dry_run, as_json=as_json)
    if isinstance(plan, int):
        return plan
    if dry_run:
        count({plan.name: plan}, bench, seed, as_json=as_json)
        return 0
    with told_to_design_anew(plan):
        played = play(plan, bench, out or Path("chop.h5"), seed)
    if played.exit_code:
        return played.exit_code

    from analysis.recorded.chop import chop_phase
    from analysis.recorded.requirements import chop_checks
    from analysis.recorded.settle import settle_of
    from campaigns.log import read_run

    with read_run(played.log) as run:
        result = chop_phase(run).stability()
        # the first cycle may still be on its way, so one alone tells nothing of settling, nor does what stays in place
        test = settle_of(run) if plan.settings()["cycles"] > 1 else None
        settling_ms = test.settling_s * 1e3 if test and test.moved else None
    results = {
        "settling_ms": settling_ms,
        "stability_urad_3sigma": result.stability_rad * 1e6,
        "inside_percent": result.inside_percent,
        "result": result,
    }
    return conclude(f"chop {alpha:g}°, {strategy}", chop_checks(result), results, [played.log], as_json=as_json)
