"""`mccd settle`: settling of a fast chop under a control strategy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Unpack

import click

from mccdcli.chop_options import chop_options, chosen_settings
from mccdcli.options import WholeRange, common_options
from mccdcli.trials import Order, run_test, settings_option

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from analysis.recorded.requirements import Check
    from campaigns.log import Run


@click.command()
@chop_options
@click.option("--cycles", type=WholeRange(1), default=25, show_default=True, help="Cycles to chop, after any learning.")
@settings_option
@common_options()
def settle(
    settings: dict[str, Any],
    strategy: str,
    alpha: float,
    form: tuple[float, float],
    cycles: int,
    model: str,
    controller: str | None,
    **order: Unpack[Order],
) -> int:
    """Chop at 5 Hz and measure how fast each move settles to ±1.7 µrad, with power and peak current.

    The log is settling.h5 unless --out names another. Exit code 1 if a requirement of the paper's Table 6.6 is missed:
    5 ms to settle, stability (3σ) of 1.7 µrad, power of 1 W, peak current of 10 A, parasitic z of 200 µm.

    \b
    Examples:
      mccd settle --strategy repetitive --out repetitive.h5
      mccd settle --strategy mbff --alpha 0 --json
      mccd settle --strategy designed --controller design/controller.toml --alpha 0
    """
    from mccdcli.own_controller import chop_plan, told_to_design_anew

    chosen = chosen_settings(
        settings, strategy=strategy, alpha=alpha, form=form, cycles=cycles, model=model, controller=controller
    )
    plan = chop_plan("settling", chosen, **order)
    if isinstance(plan, int):
        return plan
    with told_to_design_anew(plan):
        played = plan.settings()
        return run_test(plan, f"settling {played['alpha_deg']:g}°, {played['strategy']}", _measured, **order)


def _measured(run: Run) -> tuple[Sequence[Check], Mapping[str, Any]]:
    from analysis.recorded.requirements import settling_checks
    from analysis.recorded.settle import settle_of

    test = settle_of(run)
    results = {
        "settling_ms": test.settling_s * 1e3,
        "stability_urad_3sigma": test.stability.stability_rad * 1e6,
        "inside_percent": test.stability.inside_percent,
        "result": test,
    }
    return settling_checks(test), results
