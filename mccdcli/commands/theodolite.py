"""`mccd theodolite`: gain of the angle sensors against an independent instrument."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from mccdcli.options import common_options
from mccdcli.trials import conclude, count, play, settings_option


@click.command()
@click.option(
    "--readings",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE.csv",
    help="Readings of the instrument in rad: columns theta_x and theta_y, one row per held point, in their order.",
)
@settings_option
@common_options()
def theodolite(
    bench: str,
    out: Path | None,
    seed: int,
    dry_run: bool,
    as_json: bool,
    settings: dict[str, Any],
    readings: Path | None,
) -> int:
    """Hold a grid of angles and compare the sensors with a theodolite: gain corrections of both axes.

    Without --readings the bench's own instrument is read. The log is theodolite.h5 unless --out names another. Exit
    code 1 if an uncorrected gain misses the accuracy at 8.5 mrad.

    \b
    Examples:
      mccd theodolite --out theodolite.h5
      mccd theodolite --bench serial:/dev/ttyUSB0 --readings readings.csv
    """
    from analysis.recorded.readings import read_angles
    from campaigns.plans.theodolite import Theodolite

    plan = Theodolite.of(settings)
    given = None if readings is None else read_angles(readings, len(plan.points()))
    if dry_run:
        count({plan.name: plan}, bench, seed, as_json=as_json)
        return 0
    played = play(plan, bench, out or Path("theodolite.h5"), seed)
    if played.exit_code:
        return played.exit_code

    from analysis.recorded.requirements import theodolite_checks
    from analysis.recorded.sensors import theodolite_of
    from campaigns.log import read_run

    with read_run(played.log) as run:
        test = theodolite_of(run, given)
    return conclude("theodolite", theodolite_checks(test), {"result": test}, [played.log], as_json=as_json)
