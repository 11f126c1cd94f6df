"""`mccd settle`: settling of a fast chop under a control strategy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from mccdcli.options import Real, WholeRange, common_options
from mccdcli.trials import Form, conclude, controller_option, count, play, settings_option


@click.command()
@click.option(
    "--strategy", default="hybrid", show_default=True, help="hybrid, mbff, repetitive, learned-hybrid, designed …"
)
@click.option("--alpha", type=Real(), default=90.0, show_default=True, help="Direction in degrees: 0 is θx, 90 is θy.")
@click.option("--form", type=Form(), default="0:+8.5", show_default=True, help="Both positions in mrad.")
@click.option("--cycles", type=WholeRange(1), default=25, show_default=True, help="Cycles to chop, after any learning.")
@click.option("--model", default="design-4th-order", show_default=True, help="Design model: a bundled one or a file.")
@controller_option
@settings_option
@common_options()
def settle(
    bench: str,
    out: Path | None,
    seed: int,
    dry_run: bool,
    as_json: bool,
    settings: dict[str, Any],
    strategy: str,
    alpha: float,
    form: tuple[float, float],
    cycles: int,
    model: str,
    controller: str | None,
) -> int:
    """Chop at 5 Hz and measure how fast each move settles to ±1.7 µrad, with power and peak current.

    The log is settle.h5 unless --out names another. Exit code 1 if a requirement of Table 6.6 is missed.

    \b
    Examples:
      mccd settle --strategy repetitive --out repetitive.h5
      mccd settle --strategy mbff --alpha 0 --json
      mccd settle --strategy designed --controller design/controller.toml --alpha 0
    """
    from mccdcli.own_controller import chop_plan, told_to_design_anew

    chosen = {
        "strategy": strategy,
        "alpha_deg": alpha,
        "from_rad": form[0],
        "to_rad": form[1],
        "cycles": cycles,
        "model": model,
        "controller": controller,
    }
    plan = chop_plan("settling", {**chosen, **settings}, bench, seed, dry_run=dry_run, as_json=as_json)
    if isinstance(plan, int):
        return plan
    if dry_run:
        count({plan.name: plan}, bench, seed, as_json=as_json)
        return 0
    with told_to_design_anew(plan):
        played = play(plan, bench, out or Path("settle.h5"), seed)
    if played.exit_code:
        return played.exit_code

    from analysis.recorded.requirements import settling_checks
    from analysis.recorded.settle import settle_of
    from campaigns.log import read_run

    with read_run(played.log) as run:
        test = settle_of(run)
    results = {
        "settling_ms": test.settling_s * 1e3,
        "stability_urad_3sigma": test.stability.stability_rad * 1e6,
        "inside_percent": test.stability.inside_percent,
        "result": test,
    }
    return conclude(f"settling {alpha:g}°, {strategy}", settling_checks(test), results, [played.log], as_json=as_json)
