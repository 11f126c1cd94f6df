"""`mccd endstops`: noise of the position sensors against the end stops."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Unpack

import click

from mccdcli.options import common_options
from mccdcli.trials import Order, run_test, settings_option

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from analysis.recorded.requirements import Check
    from campaigns.log import Run


@click.command()
@settings_option
@common_options()
def endstops(settings: dict[str, Any], **order: Unpack[Order]) -> int:
    """Pull the mechanism against its end stops in eight directions and measure the sensors' noise there.

    The log is endstops.h5 unless --out names another. Exit code 1 if a 3σ exceeds 30 nm.

    \b
    Examples:
      mccd endstops --out endstops.h5
      mccd endstops --set current_a=5.0 --dry-run
    """
    from campaigns.plans import make_plan

    return run_test(make_plan("endstops", settings), "end stops", _measured, **order)


def _measured(run: Run) -> tuple[Sequence[Check], Mapping[str, Any]]:
    from analysis.recorded.requirements import endstop_checks
    from analysis.recorded.sensors import endstops_of

    test = endstops_of(run)
    return endstop_checks(test), {"result": test}
