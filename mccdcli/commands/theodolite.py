"""`mccd theodolite`: gain of the angle sensors against an independent instrument."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import click

from mccdcli.options import common_options
from mccdcli.trials import Order, run_test, settings_option

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from analysis.recorded.requirements import Check
    from campaigns.log import Run


@click.command()
@click.option(
    "--readings",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE.csv",
    help="Readings of the instrument in rad: columns theta_x and theta_y, one row per held point, in their order.",
)
@settings_option
@common_options()
def theodolite(settings: dict[str, Any], readings: Path | None, **order: Unpack[Order]) -> int:
    """Hold a grid of angles and compare the sensors with a theodolite: gain corrections of both axes.

    Without --readings the bench's own instrument is read. The log is theodolite.h5 unless --out names another. Exit
    code 1 if an uncorrected gain is off by more than 85 µrad at 8.5 mrad.

    \b
    Examples:
      mccd theodolite --out theodolite.h5
      mccd theodolite --bench serial:/dev/ttyUSB0 --readings readings.csv
    """
    from analysis.recorded.readings import read_angles
    from campaigns.plans.theodolite import Theodolite

    plan = Theodolite.of(settings)
    given = None if readings is None else read_angles(readings, len(plan.points()))
    return run_test(plan, "theodolite", partial(_measured, given=given), **order)


def _measured(run: Run, *, given: NDArray[np.float64] | None) -> tuple[Sequence[Check], Mapping[str, Any]]:
    from analysis.recorded.requirements import theodolite_checks
    from analysis.recorded.sensors import theodolite_of

    test = theodolite_of(run, given)
    return theodolite_checks(test), {"result": test}
