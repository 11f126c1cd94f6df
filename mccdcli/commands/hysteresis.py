"""`mccd hysteresis`: loops at several amplitudes and steps at several offsets."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, Unpack

import click

from mccdcli.idle_options import refuse_typed
from mccdcli.options import common_options
from mccdcli.trials import Order, run_test, settings_option

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from analysis.recorded.requirements import Check
    from campaigns.log import Run


@click.command()
@click.option("--axis", default="theta_x", show_default=True, help="Axis to drive.")
@click.option("--fit/--no-fit", default=True, show_default=True, help="Fit Jiles–Atherton and polynomial to the loops.")
@settings_option
@common_options()
def hysteresis(settings: dict[str, Any], axis: str, fit: bool, **order: Unpack[Order]) -> int:
    """Drive slow sine loops and fed-forward steps at offsets, open loop, and measure the hysteresis.

    The log is hysteresis.h5 unless --out names another. Nothing is required of the result. Units end the names of
    settings: torques_nm is in N m, not nanometre, offsets_rad in rad.

    \b
    Examples:
      mccd hysteresis --axis theta_y --out hysteresis-y.h5
      mccd hysteresis --set 'torques_nm=[0.05, 0.08]' --no-fit
    """
    from campaigns.plans import make_plan

    if "axis" in settings:
        refuse_typed(("axis",), "and --set axis choose the same; leave out one of the two")
    plan = make_plan("hysteresis", {"axis": axis, **settings})
    return run_test(plan, f"hysteresis {plan.settings()['axis']}", partial(_measured, fit=fit), **order)


def _measured(run: Run, *, fit: bool) -> tuple[Sequence[Check], Mapping[str, Any]]:
    from analysis.recorded.hysteresis import loops_of, steps_of
    from analysis.recorded.loop_fit import loop_fit_of
    from analysis.recorded.requirements import hysteresis_checks

    loops = loops_of(run)
    results = {"loops": loops, "steps": steps_of(run), "fit": loop_fit_of(run) if fit else None}
    return hysteresis_checks(loops), results
