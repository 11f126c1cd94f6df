"""`mccd thermal`: drift during a long chop, and the plant at two temperatures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from mccdcli.options import common_options
from mccdcli.trials import conclude, count_campaign, play_campaign, settings_option
from sim_backend.safe_write import unnamed_folder


@click.command()
@click.option(
    "--sweeps/--no-sweeps",
    default=True,
    show_default=True,
    help="Also set the cold finger to 77 K and 63.5 K, which may take a real bench hours, and sweep 5–100 Hz at both.",
)
@click.option("--resume", is_flag=True, help="Continue in a folder that holds part of this test.")
@settings_option
@common_options()
def thermal(
    bench: str,
    out: Path | None,
    seed: int,
    dry_run: bool,
    as_json: bool,
    settings: dict[str, Any],
    sweeps: bool,
    resume: bool,
) -> int:
    """Chop at 5 Hz for five minutes and look for drift; sweep both axes at two temperatures and compare.

    The logs go into the folder thermal unless --out names another; --resume plays what it lacks. --set changes the
    chop. The sweeps command the temperature of the cold finger; --no-sweeps leaves it as it is. Exit code 1 if a
    position drifts by more than 1.7 µrad.

    \b
    Examples:
      mccd thermal --out thermal
      mccd thermal --out thermal --resume
      mccd thermal --no-sweeps --set cycles=100
    """
    from campaigns.playing.thermal_campaign import AXES, COLD, sweep_name, thermal_campaign

    campaign = thermal_campaign(settings, sweeps=sweeps)
    if dry_run:
        count_campaign(campaign, bench, seed, as_json=as_json)
        return 0
    played = play_campaign(campaign, out or unnamed_folder(Path("thermal")), bench, seed, resume=resume)
    if played.exit_code:
        return played.exit_code

    from analysis.recorded.drift import drift_of
    from analysis.recorded.requirements import drift_checks, sweep_checks
    from analysis.recorded.temperature import compared_sweeps
    from campaigns.log import read_run

    with read_run(played.logs["thermal"]) as run:
        test = drift_of(run)
    checks = [*drift_checks(test)]
    results: dict[str, Any] = {"drift": test}
    for axis in AXES if sweeps else ():
        first, second = (played.logs[sweep_name(kelvin, axis)] for kelvin in COLD)
        with read_run(first) as one, read_run(second) as two:
            results[axis] = compared_sweeps(one, two)
        checks += sweep_checks(axis, results[axis])
    return conclude("thermal", checks, results, list(played.logs.values()), as_json=as_json)
