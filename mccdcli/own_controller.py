"""A designed strategy without a controller: one is designed from the bench's own logs, and kept for the next time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mccdcli.output import say
from mccdcli.trials import count_campaign, play_campaign

if TYPE_CHECKING:
    from campaigns.plans import Plan
    from sim_backend.bench import Limits


def chop_plan(
    name: str, settings: Mapping[str, Any], bench: str, seed: int, *, dry_run: bool, as_json: bool
) -> Plan | int:
    """Return the plan of a chop by name; an exit code where a controller's design ends the command.

    A designed strategy without a controller gets that of the folder designed-BENCH, designed now unless it is there:
    from the logs in it, recorded now where they are missing. Raises ConfigError for the folder of another bench, and
    for settings that cannot be, before anything is recorded.
    """
    from campaigns.plans import make_plan
    from campaigns.strategies import STRATEGIES
    from campaigns.strategies.controller import FILE_NAME

    designed = STRATEGIES.get(settings["strategy"], "").startswith("designed:")
    if settings["controller"] is not None or not designed:
        return make_plan(name, dict(settings))
    make_plan(name, {**settings, "controller": FILE_NAME})
    from campaigns.benches import open_bench
    from campaigns.names import check_file_name
    from campaigns.plans.chop import TIP_TILT
    from campaigns.playing.designed_campaign import measuring_campaign

    with closing(open_bench(bench, seed)) as opened:
        limits, axes = opened.limits, opened.axes
        folder = Path(f"designed-{opened.identity.name}")
    check_file_name(folder.name, "folder")
    controller = folder / FILE_NAME
    if controller.exists():
        _require_same_bench(folder, bench)
        say(f"mccd: no --controller is given: {controller} is played, designed before for this bench")
    else:
        campaign = measuring_campaign([axis for axis in TIP_TILT if axis in axes])
        if dry_run:
            say(f"mccd: no --controller is given: one would first be designed in {folder} from these logs")
            count_campaign(campaign, bench, seed, as_json=as_json)
            return 0
        say(f"mccd: no --controller is given: one is designed in {folder}, from sweeps, a rest and hysteresis loops")
        played = play_campaign(campaign, folder, bench, seed, resume=True)
        if played.exit_code:
            return played.exit_code
        _design(list(played.logs.values()), limits, axes, folder)
        say(f"mccd: {controller} is kept: it is played now and the next time")
    return make_plan(name, {**settings, "controller": str(controller)})


def _design(logs: Sequence[Path], limits: Limits, axes: tuple[str, ...], folder: Path) -> None:
    from analysis.design.from_logs import design_from_logs
    from campaigns.log import read_run
    from campaigns.plans.chop import TIP_TILT
    from mccdcli.progress import progress
    from sim_backend.errors import ConfigError

    with ExitStack() as stack, progress("designing") as report:
        report(0.0, 1.0, "a controller")
        if design_from_logs([stack.enter_context(read_run(log)) for log in logs], limits, axes, folder) is None:
            raise ConfigError(
                f"the bench has the axes {', '.join(axes)}; a design needs one of {', '.join(TIP_TILT)}: choose "
                "another strategy"
            )


def _require_same_bench(folder: Path, bench: str) -> None:
    """Raise ConfigError where the logs beside a kept controller are not this bench's."""
    from campaigns.benches import bench_kind
    from campaigns.playing.campaign_run import read_state
    from sim_backend.errors import ConfigError

    state = read_state(folder)
    kind, rest = bench_kind(bench)
    before = None if state is None else state["fingerprint"].get("bench digest")
    if before != kind.digest(rest):
        raise ConfigError(
            f"the controller in {folder} was designed for another bench than '{bench}'; give --controller, or move the "
            "folder away"
        )
