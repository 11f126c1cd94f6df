"""`mccd chop`: positional stability of a chop."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, Unpack

import click

from mccdcli.chop_options import chop_options, chosen_settings
from mccdcli.options import Real, WholeRange, common_options
from mccdcli.trials import Order, run_test, settings_option

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from analysis.recorded.requirements import Check
    from campaigns.log import Run


@click.command()
@chop_options
@click.option("--cycles", type=WholeRange(1), default=15, show_default=True, help="Cycles to chop.")
@click.option("--frequency", type=Real(), default=0.5, show_default=True, help="Chop frequency in Hz.")
@settings_option
@common_options()
def chop(
    settings: dict[str, Any],
    alpha: float,
    form: tuple[float, float],
    strategy: str,
    cycles: int,
    frequency: float,
    model: str,
    controller: str | None,
    **order: Unpack[Order],
) -> int:
    """Chop between two positions and measure stability, repeatability and accuracy at both.

    The log is chop.h5 unless --out names another. Exit code 1 if a requirement of the paper's Table 6.6 is missed at
    either position: stability (3σ) and repeatability of 1.7 µrad, accuracy of 85 µrad.

    \b
    Examples:
      mccd chop --alpha 120 --form 0:+8.5 --out chop-120.h5
      mccd chop --form=-8.5:+8.5 --strategy mbff --json
    """
    from mccdcli.own_controller import chop_plan, told_to_design_anew

    chosen = chosen_settings(
        settings,
        strategy=strategy,
        alpha=alpha,
        form=form,
        cycles=cycles,
        frequency=frequency,
        model=model,
        controller=controller,
    )
    plan = chop_plan("chop", chosen, **order)
    if isinstance(plan, int):
        return plan
    with told_to_design_anew(plan):
        played = plan.settings()
        measured = partial(_measured, cycles=played["cycles"])
        return run_test(plan, f"chop {played['alpha_deg']:g}°, {played['strategy']}", measured, **order)


def _measured(run: Run, *, cycles: int) -> tuple[Sequence[Check], Mapping[str, Any]]:
    from analysis.recorded.chop import chop_phase
    from analysis.recorded.requirements import chop_checks
    from analysis.recorded.settle import settle_of

    result = chop_phase(run).stability()
    # the first cycle may not have converged, so one alone says nothing of settling, nor does a chop without motion
    test = settle_of(run) if cycles > 1 else None
    results = {
        "settling_ms": test.settling_s * 1e3 if test and test.moved else None,
        "stability_urad_3sigma": result.stability_rad * 1e6,
        "inside_percent": result.inside_percent,
        "result": result,
    }
    return chop_checks(result), results
