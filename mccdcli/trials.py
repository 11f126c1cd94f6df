"""What the commands of the tests share: play a plan, or only count it, and show a result against its limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypedDict, TypeVar, Unpack

import click

from mccdcli.failures import INTERRUPTED
from mccdcli.options import given_note
from mccdcli.output import BAD, GOOD, emit, plain, say, table
from mccdcli.progress import progress
from sim_backend.documents import SyntaxFault, toml_of

if TYPE_CHECKING:
    from analysis.recorded.requirements import Check
    from campaigns.log import Run
    from campaigns.plans import Estimate, Plan
    from campaigns.playing.campaign import Campaign
    from campaigns.playing.campaign_run import Complete

F = TypeVar("F", bound=Callable[..., Any])

# SI unit → what people read, from small to large: the value from which on it is used, its name, how many make one
SHOWN: Final[Mapping[str, tuple[tuple[float, str, float], ...]]] = {
    "rad": ((0.0, "µrad", 1e6), (1e-3, "mrad", 1e3)),
    "m": ((0.0, "nm", 1e9), (1e-6, "µm", 1e6), (1e-3, "mm", 1e3)),
    "s": ((0.0, "ms", 1e3),),
    "J": ((0.0, "µJ", 1e6),),
    "1": ((0.0, "%", 1e2),),
}


def settings_option(command: F) -> F:
    """Decorator that adds `--set NAME=VALUE`, which the command receives as `settings`: dict."""
    return click.option(
        "--set",
        "settings",
        multiple=True,
        callback=_parsed,
        metavar="NAME=VALUE",
        help="Another setting of the plan, in the unit that ends its name; repeatable. `mccd campaign list --plans` "
        "lists names, defaults and units.",
    )(command)


def _parsed(_ctx: click.Context, param: click.Parameter, texts: tuple[str, ...]) -> dict[str, Any]:
    settings: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name.strip():
            raise click.BadParameter(f"{text!r} is not NAME=VALUE", param=param)
        *tables, last = (part.strip() for part in name.split("."))
        own = settings
        for outer in tables:  # as in `tuning.learning_s`
            own = own.setdefault(outer, {})
            if not isinstance(own, dict):
                raise click.BadParameter(f"{text!r}: {outer} is a value already; set it once", param=param)
        try:
            own[last] = toml_of(f"value = {value}", f"--set {name}")["value"]
        except SyntaxFault:
            own[last] = value.strip()  # a bare word is a text
    return settings


class Order(TypedDict):
    """What the common options of a test ask for, as the commands get it."""

    bench: str
    out: Path | None
    seed: int
    dry_run: bool
    as_json: bool


def run_test(
    plan: Plan,
    title: str,
    measured: Callable[[Run], tuple[Sequence[Check], Mapping[str, Any]]],
    **order: Unpack[Order],
) -> int:
    """Play a plan and show what is `measured` in its log: checks and results; return the exit code.

    A dry run only counts. The log is named after the plan unless the order names another.
    """
    bench, seed = order["bench"], order["seed"]
    if order["dry_run"]:
        count({plan.name: plan}, bench, seed, as_json=order["as_json"])
        return 0
    played = play(plan, bench, order["out"] or Path(f"{plan.name}.h5"), seed)
    if played.exit_code:
        return played.exit_code

    from campaigns.log import read_run

    with read_run(played.log) as run:
        checks, results = measured(run)
    return conclude(title, checks, results, [played.log], as_json=order["as_json"])


class Played(NamedTuple):
    """A recorded run: its log, and the exit code that it calls for on its own (0, or 130 when it was paused)."""

    log: Path
    run_uid: str
    exit_code: int


def play(plan: Plan, bench: str, log: Path, seed: int) -> Played:
    """Play `plan` on the bench at the address `bench` into a new log, with progress on standard error."""
    from contextlib import closing

    from campaigns.benches import open_bench
    from campaigns.plans import estimate

    _require_models(plan)
    with closing(open_bench(bench, seed)) as opened, progress(plan.title) as report:
        counted = estimate(plan, opened)
        from campaigns.playing.runner import run_plan  # brings the logs: what cannot be played is told before

        outcome = run_plan(plan, opened, log, seed=seed, report=report, counted=counted, note=given_note())
    if outcome.status == "complete":
        return Played(outcome.path, outcome.run_uid, 0)
    say(f"mccd: {outcome.status}: {outcome.reason}; {outcome.path} holds what was recorded")
    return Played(outcome.path, outcome.run_uid, INTERRUPTED)


LARGE_BYTES: Final = 150e6
"""Logs of a campaign that take more are announced before it begins."""


class PlayedCampaign(NamedTuple):
    """A played campaign: the log of every run by its name, and the exit code as with `Played`."""

    logs: dict[str, Path]
    status: str
    exit_code: int


def play_campaign(
    campaign: Campaign,
    folder: Path,
    bench: str,
    seed: int,
    *,
    resume: bool | None = None,
    then: str = "",
    complete: Complete | None = None,
) -> PlayedCampaign:
    """Play what `folder` lacks of a campaign, with progress on standard error.

    `resume` is the command's --resume; a command without that option always continues what the folder holds. Logs of
    more than LARGE_BYTES are announced there first, with what will be recorded `then`. `complete` hears of every run
    that ends, as `run_campaign` does.
    """
    from campaigns.playing.campaign_run import run_campaign

    def announce(size_bytes: float) -> None:
        if size_bytes > LARGE_BYTES:
            say(f"mccd: the logs will take {size_bytes / 1e6:.0f} MB in {folder}{then}")

    with progress(campaign.title or campaign.name) as report:
        outcome = run_campaign(
            campaign,
            folder,
            address=bench,
            seed=seed,
            resume=resume is not False,
            report=report,
            announce=announce,
            complete=complete,
            note=given_note(),
        )
    logs = {run.name: run.log for run in outcome.runs}
    if outcome.status == "complete":
        return PlayedCampaign(logs, outcome.status, 0)
    how = "the same command" if resume is None else "the same command with --resume"
    say(f"mccd: {outcome.status}; {folder} holds what was recorded; {how} continues")
    return PlayedCampaign(logs, outcome.status, INTERRUPTED)


def count(plans: Mapping[str, Plan], bench: str, seed: int, *, as_json: bool) -> None:
    """Show what playing `plans` would take, without moving anything."""
    from contextlib import closing

    from campaigns.benches import open_bench
    from campaigns.plans import estimate

    for plan in plans.values():
        _require_models(plan)
    with closing(open_bench(bench, seed)) as opened:
        counted = {name: estimate(plan, opened) for name, plan in plans.items()}
    show_estimates(counted, as_json=as_json)


def count_campaign(campaign: Campaign, bench: str, seed: int, *, as_json: bool) -> None:
    """Show what playing a campaign would take, run by run, without moving anything."""
    from campaigns.playing.counting import estimate_campaign
    from sim_backend.memory import keep_freed_memory

    keep_freed_memory()  # a quarter of the time would go to the system, for the waveforms of run after run
    show_estimates(estimate_campaign(campaign, bench, seed), as_json=as_json)


def _require_models(plan: Plan) -> None:
    """Raise ConfigError for a design model that is none: before a bench is opened for it."""
    from sim_backend.model import load_model

    for name in plan.design_models():
        load_model(name)


def show_estimates(counted: Mapping[str, Estimate], *, as_json: bool) -> None:
    """Show estimates by run: steps, duration, bytes, and the demands beside their limits."""
    rows = [(name, *_described(one)) for name, one in counted.items()]
    total = ("in all", str(sum(e.segments for e in counted.values())), *_amount(list(counted.values())), "", "")
    heads = ("run", "steps", "duration", "bytes", "peak current", "peak reference")
    emit({"runs": counted}, as_json=as_json, text=table([*rows, total] if len(rows) > 1 else rows, heads=heads))


def _described(one: Estimate) -> tuple[str, ...]:
    reach = []
    for axis, peak in one.peak_reference.items():
        if peak:
            unit = "m" if axis == "z" else "rad"
            reach.append(f"{axis} {quantity(peak, unit)} of {quantity(one.limit_reference[axis], unit)}")
    current = f"{one.peak_current_a:.3g} of {one.limit_current_a:.3g} A"
    return (str(one.segments), *_amount([one]), current, ", ".join(reach) or "none")


def _amount(several: Sequence[Estimate]) -> tuple[str, str]:
    return f"{sum(e.duration_s for e in several):.1f} s", f"{sum(e.bytes for e in several) / 1e6:.1f} MB"


def conclude(
    test: str,
    checks: Sequence[Check],
    results: Mapping[str, Any],
    logs: Sequence[Path],
    *,
    as_json: bool,
) -> int:
    """Show a test's checks with their limits, and return the exit code: 1 if one failed."""
    ok = all(check.ok for check in checks)
    described = [{**plain(check), "ok": check.ok} for check in checks]
    rows = [
        (c.name, quantity(c.value, c.unit), "" if c.limit is None else quantity(c.limit, c.unit), _verdict(c))
        for c in checks
    ]
    text = "\n\n".join(
        [
            table(rows, heads=(test, "result", "limit", "")),
            f"{_outcome(checks)}; log: {', '.join(map(str, logs))}",
        ]
    )
    emit(
        {"test": test, "passed": ok, "logs": list(logs), **results, "checks": described},
        as_json=as_json,
        text=text,
        colours={"ok": GOOD, "passed": GOOD, "FAILED": BAD},
    )
    return 0 if ok else 1


def _outcome(checks: Sequence[Check]) -> str:
    """Return the outcome of a test in words: it has passed only where there was a limit to pass."""
    if not all(check.ok for check in checks):
        return "FAILED"
    return "passed" if any(check.limit is not None for check in checks) else "measured, no limit"


def _verdict(check: Check) -> str:
    if not check.ok:
        return "FAILED"
    return "no limit" if check.limit is None else "ok"


def quantity(value: float, unit: str) -> str:
    """Return a value in SI as people read it, in four digits; a dash for none."""
    if not math.isfinite(value):
        return "—"
    scales = [scale for scale in SHOWN.get(unit, ((0.0, unit, 1.0),)) if abs(value) >= scale[0]]
    _, name, per = scales[-1] if scales else (0.0, unit, 1.0)
    return f"{value * per:.4g} {name}"
