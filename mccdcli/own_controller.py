"""A designed strategy without a controller: one is designed from the bench's own logs, and kept for the next time."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Unpack

from mccdcli.chop_options import is_designed
from mccdcli.output import say
from mccdcli.trials import Order, count_campaign, play_campaign

if TYPE_CHECKING:
    from campaigns.plans import Plan
    from sim_backend.bench import Identity, Limits

KEPT: Final = "designed-"
"""A controller that was designed for a bench without being asked for is kept in a folder of this and its name."""


def chop_plan(name: str, settings: Mapping[str, Any], **order: Unpack[Order]) -> Plan | int:
    """Return the plan of a chop by name; an exit code where a controller's design ends the command.

    A designed strategy without a controller gets that of the folder designed-BENCH, designed now unless it is there:
    from the logs in it, recorded now where they are missing. The order's `out` is where the chop itself goes, not
    these. Raises ConfigError for the folder of another bench, and for settings that cannot be, before anything is
    recorded.
    """
    from campaigns.plans import make_plan
    from campaigns.strategies.controller import FILE_NAME

    if settings["controller"] is not None or not is_designed(settings["strategy"]):
        return make_plan(name, dict(settings))
    make_plan(name, {**settings, "controller": FILE_NAME})
    from campaigns.benches import open_bench
    from campaigns.names import check_file_name
    from campaigns.plans.chop import TIP_TILT
    from campaigns.playing.designed_campaign import measuring_campaign

    bench, seed = order["bench"], order["seed"]
    with closing(open_bench(bench, seed)) as opened:
        limits, axes, identity = opened.limits, opened.axes, opened.identity
    folder = Path(f"{KEPT}{identity.name}")
    check_file_name(folder.name, "folder")
    controller = folder / FILE_NAME
    if controller.exists():
        _require_same_bench(folder, bench, identity)
        say(f"mccd: no --controller is given: {controller} is played, designed before for this bench; {_anew(folder)}")
    else:
        campaign = measuring_campaign([axis for axis in TIP_TILT if axis in axes])
        if order["dry_run"]:
            say(f"mccd: no --controller is given: one would first be designed in {folder} from these logs")
            count_campaign(campaign, bench, seed, as_json=order["as_json"])
            return 0
        say(f"mccd: no --controller is given: one is designed in {folder}, from sweeps, a rest and hysteresis loops")
        played = play_campaign(campaign, folder, bench, seed)
        if played.exit_code:
            return played.exit_code
        _design(list(played.logs.values()), limits, axes, folder)
        say(f"mccd: {controller} is kept: it is played now and the next time; {_anew(folder)}")
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


@contextmanager
def told_to_design_anew(plan: Plan) -> Iterator[None]:
    """Let the error of a chop whose kept controller no longer fits say which folder prevents a new one."""
    from sim_backend.errors import CheckError

    try:
        yield
    except CheckError as error:
        folder = Path(str(plan.settings().get("controller") or "")).parent
        if not folder.name.startswith(KEPT):
            raise
        raise CheckError(f"{error}: the controller is {_anew(folder)}") from None


def _anew(folder: Path) -> str:
    return f"kept in {folder}; move it away to identify and design anew"


def _require_same_bench(folder: Path, bench: str, identity: Identity) -> None:
    """Raise ConfigError where the logs beside a kept controller are not this bench's.

    A simulated bench is recognised by its model; any other by who it said it was when it was measured.
    """
    from campaigns.benches import bench_kind
    from campaigns.playing.campaign_run import read_state
    from sim_backend.errors import ConfigError

    state = read_state(folder)
    kind, rest = bench_kind(bench)
    before = None if state is None else state["fingerprint"].get("bench digest")
    found = ""
    if state is None or before != kind.digest(rest):
        found = "was designed for another bench"
    elif not kind.repeatable:
        found = _other_identity(folder, {run["log"] for run in state["runs"]}, asdict(identity))
    if found:
        raise ConfigError(
            f"the controller in {folder} {found} than '{bench}'; give --controller, or move {folder} away to identify "
            "this bench and design anew"
        )


def _other_identity(folder: Path, names: Collection[str], identity: Mapping[str, str]) -> str:
    """Say how the bench of the logs in a folder that have these names is another one, nothing where it is not."""
    from campaigns.log.listing import list_logs

    logs = [one for one in list_logs(folder) if one.path.parent == folder and one.path.name in names]
    before = [one.bench for one in logs if one.bench is not None]
    if not before:
        return "has no log left that says whether it was designed for another bench"
    for one in before:
        changes = [f"{key} was '{one.get(key, '')}' and is '{is_now}'" for key, is_now in identity.items()]
        differs = [change for change, key in zip(changes, identity, strict=True) if one.get(key) != identity[key]]
        if differs:
            return f"was designed for another bench ({', '.join(differs)})"
    return ""
