"""`mccd simulate`: play a plan or a waveform on a model and log it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mccdcli.idle_options import refuse_typed
from mccdcli.options import common_options
from mccdcli.output import emit
from mccdcli.trials import count, play, settings_option

if TYPE_CHECKING:
    from campaigns.plans import Plan


@click.command()
@click.option("--model", default="as-built", show_default=True, help="Model to simulate: a bundled one or a file.")
@click.option("--plan", default="freerun", show_default=True, help="Plan to play: `mccd campaign list --plans`.")
@click.option(
    "--waveform",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE.csv",
    help="Play this instead of a plan, at the sample rate of the model: a column per axis (theta_x … in N m, z in N), "
    "a row per sample. --set repeats=N plays it N times.",
)
@settings_option
@common_options("out", "seed", "dry_run", "note", "json")
def simulate(
    out: Path | None,
    seed: int,
    dry_run: bool,
    as_json: bool,
    settings: dict[str, Any],
    model: str,
    plan: str,
    waveform: Path | None,
) -> int:
    """Play a plan, or a waveform of your own, on any model, and log what its bench measures.

    The log is simulate.h5 unless --out names another.

    \b
    Examples:
      mccd simulate --model extended.toml --plan chop --set cycles=3 --out chop.h5
      mccd simulate --waveform torque.csv
    """
    from campaigns.plans import make_plan

    if waveform is not None:
        refuse_typed(("plan",), "chooses a plan, and --waveform is played instead; leave out one of the two")
    chosen = make_plan(plan, settings) if waveform is None else _waveform(waveform, settings)
    bench = f"sim:{model}"
    if dry_run:
        count({chosen.name: chosen}, bench, seed, as_json=as_json)
        return 0
    played = play(chosen, bench, out or Path("simulate.h5"), seed)
    result = {"plan": chosen.name, "model": model, "log": played.log, "run_uid": played.run_uid}
    emit(result, as_json=as_json, text=f"{chosen.title} on {model}: {played.log}")
    return played.exit_code


def _waveform(file: Path, settings: dict[str, Any]) -> Plan:
    from campaigns.plans.waveform import Waveform  # brings the reading of tables, and logs with it

    if "file" in settings:
        raise click.UsageError("--set file and --waveform choose the same; leave out --set file")
    return Waveform.of({"file": str(file), **settings})
