"""Play a campaign into a folder: what is missing is run, what is complete is kept, what is partial is set aside."""

from __future__ import annotations

import contextlib
import dataclasses
import fcntl
import hashlib
import json
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from campaigns.benches import bench_kind, open_bench
from campaigns.log import read_run, sidecar_of
from campaigns.log.child import ReaderFailedError
from campaigns.log.disk_space import require_free
from campaigns.log.opening import has_writer
from campaigns.plans import Estimate, Plan, estimate
from campaigns.playing.campaign import Campaign, in_run, run_seed
from campaigns.playing.counting import within_bounds
from campaigns.playing.interrupts import Interrupts
from campaigns.playing.runner import Outcome, Report, fingerprint, fingerprint_of, run_plan
from campaigns.playing.side_by_side import free_cores, share
from campaigns.version import tool_version
from sim_backend.documents import json_of, read_text
from sim_backend.errors import ConfigError, DataError
from sim_backend.safe_write import open_lock, write_text
from sim_backend.small_files import STATE_BYTES

STATE_FILE = "campaign.json"
LOCK_FILE = ".campaign.lock"
STATE_SCHEMA = "mccd-campaign-state/1"
_NO_STATE = "delete it, the logs beside it hold all there is"


class _KeptRun(msgspec.Struct):
    name: str
    plan: str
    log: str
    seed: int
    status: str
    run_uid: str


class _KeptState(msgspec.Struct):
    """What the state file has to hold."""

    campaign: dict[str, Any]
    fingerprint: dict[str, str]
    status: str
    runs: list[_KeptRun]


@dataclass(frozen=True)
class RunState:
    """What is known of one run: its log, its status, and whether it was played now or kept from before."""

    name: str
    plan: str
    log: Path
    seed: int
    fingerprint: str
    disturbance: float = 1.0
    status: str = "missing"
    run_uid: str = ""
    played: bool = False


Complete = Callable[[Mapping[str, RunState]], None]
"""Receives how far a campaign is: the state of every run by its name."""


@dataclass(frozen=True)
class CampaignOutcome:
    """How a campaign ended: `complete`, or `paused` by the user; every run in the order of the file."""

    name: str
    folder: Path
    status: str
    runs: tuple[RunState, ...]


def run_campaign(
    campaign: Campaign,
    folder: str | Path,
    *,
    address: str = "sim",
    seed: int = 0,
    resume: bool = False,
    report: Report | None = None,
    announce: Callable[[float], None] | None = None,
    complete: Complete | None = None,
    note: str = "",
) -> CampaignOutcome:
    """Play every run of `campaign` that the folder does not hold yet, each into `folder`/<run>.h5.

    With `resume` a folder of the same campaign, seed and bench is completed; without, it must hold none. Nothing moves
    unless all segments of all runs keep the limits; before anything does, `announce` is called with the bytes that the
    missing logs will take. `complete` is called with all runs first and after each that ends, from any thread. `note`
    is written to each log that is made. The first Ctrl-C ends it after the current segment, as *paused*. Raises
    ConfigError for another campaign's folder, DataError for a log that another program is writing or a disk with too
    little room for what is missing, and whatever a run raises.
    """
    home, plans, levels = Path(folder), campaign.plans(), campaign.levels()
    survey = _survey(campaign, address, seed)
    estimates = within_bounds(campaign, {name: counted for name, (counted, _) in survey.items()})
    states = {
        name: RunState(name, plans[name].name, home / f"{name}.h5", run_seed(seed, name), mark, levels[name])
        for name, (_, mark) in survey.items()
    }
    whole = _whole_fingerprint(campaign, states, address, seed)
    with _locked(home):
        _claim(home, campaign, whole, resume)
        _refuse_open_logs(states)
        states = {name: _found(state) for name, state in states.items()}
        size_bytes = sum(estimates[name].bytes for name, state in states.items() if state.status != "complete")
        require_free(home, size_bytes)
        if announce is not None:
            announce(size_bytes)
        try:
            status = _play_missing(plans, states, estimates, address, note, report, complete or (lambda _: None))
        except BaseException as error:
            with contextlib.suppress(DataError):  # the error that ended the campaign is the one to report
                _write_state(home, campaign, whole, "failed" if isinstance(error, Exception) else "aborted", states)
            raise
        _write_state(home, campaign, whole, status, states)
    return CampaignOutcome(campaign.name, home, status, tuple(states.values()))


def _play_missing(
    plans: dict[str, Plan],
    states: dict[str, RunState],
    estimates: dict[str, Estimate],
    address: str,
    note: str,
    report: Report | None,
    complete: Complete,
) -> str:
    """Play every run without a complete log, replacing its entry in `states`; return the campaign's status."""
    missing = [name for name, state in states.items() if state.status != "complete"]
    tally = _Tally(report, sum(estimates[name].samples for name in missing))
    kind, _ = bench_kind(address)

    def play(name: str) -> None:
        _set_aside(states[name].log)
        states[name] = dataclasses.replace(states[name], played=True)
        try:
            ended = _play(plans[name], states[name], address, note, signals, tally.of(name), estimates[name])
        except BaseException:
            states[name] = _found(states[name])
            raise
        states[name] = dataclasses.replace(states[name], status=ended.status, run_uid=ended.run_uid)
        tally.done[name] = estimates[name].samples
        complete(states)

    complete(states)
    with Interrupts() as signals:
        share(missing, play, free_cores() if kind.many else 1, signals)
    return "complete" if all(state.status == "complete" for state in states.values()) else "paused"


class _Tally:
    """Adds up what runs that may play at once have played, and passes the sum on."""

    def __init__(self, report: Report | None, total: float) -> None:
        self.done: dict[str, float] = {}
        self._report, self._total = report, total
        self._lock = threading.Lock()

    def of(self, name: str) -> Report | None:
        """Return the report of one run."""
        if self._report is None:
            return None
        report = self._report

        def add(done: float, _total: float, what: str) -> None:
            with self._lock:
                self.done[name] = done
                report(sum(self.done.values()), self._total, f"{name}: {what}")

        return add


@contextlib.contextmanager
def _locked(home: Path) -> Iterator[None]:
    """Keep a second process out of the folder; the lock ends with the process, however that ends."""
    home.mkdir(parents=True, exist_ok=True)
    with open_lock(home / LOCK_FILE) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ConfigError(f"{home}: another mccd is playing a campaign there; wait for it to end") from None
        yield


def read_state(folder: str | Path) -> dict[str, Any] | None:
    """Return the state file of a campaign's folder, None if there is none; raises DataError when it is broken."""
    path = Path(folder) / STATE_FILE
    if not path.exists():
        return None
    text = read_text(path, "state of a campaign", most_bytes=STATE_BYTES, error=DataError, fix=_NO_STATE)
    state: dict[str, Any] = json_of(text, str(path), error=DataError, fix=_NO_STATE)
    if not isinstance(state, dict) or state.get("schema") != STATE_SCHEMA:
        raise DataError(f"{path}: not the state of a campaign ({STATE_SCHEMA}); choose another folder")
    try:
        msgspec.convert(state, _KeptState)
    except msgspec.ValidationError as error:
        raise DataError(f"{path}: {error}; {_NO_STATE}") from None
    return state


def _survey(campaign: Campaign, address: str, seed: int) -> dict[str, tuple[Estimate, str]]:
    """Return the estimate and the fingerprint of every run; nothing moves."""
    survey, levels = {}, campaign.levels()
    for name, plan in campaign.plans().items():
        own = run_seed(seed, name)
        with in_run(campaign, name), contextlib.closing(open_bench(address, own, levels[name])) as bench:
            survey[name] = estimate(plan, bench), fingerprint(plan, bench, own)
    return survey


def _whole_fingerprint(campaign: Campaign, states: dict[str, RunState], address: str, seed: int) -> dict[str, str]:
    """What a resumed campaign must share with the one it continues, part by part, so that an error can say which."""
    kind, rest = bench_kind(address)
    runs = {name: state.fingerprint for name, state in states.items()}
    return {
        "campaign": campaign.name,
        "runs": hashlib.sha256(json.dumps(runs, sort_keys=True).encode()).hexdigest(),
        "seed": str(seed),
        "bench": address,
        "bench digest": kind.digest(rest),
        "mccd": tool_version(),
    }


def _claim(home: Path, campaign: Campaign, whole: dict[str, str], resume: bool) -> None:
    """Make the folder this campaign's own, or make sure that it is."""
    state = read_state(home)
    if state is None:
        _write_state(home, campaign, whole, "running", {})
        return
    if not resume:
        raise ConfigError(f"{home} holds a campaign already; continue it with --resume or choose another folder")
    before = state["fingerprint"]
    differs = [key for key in whole if before.get(key) != whole[key]]
    if differs:
        changes = ", ".join(f"{key} was {str(before.get(key))[:40]} and is {whole[key][:40]}" for key in differs)
        raise ConfigError(f"{home} cannot be resumed: {changes}; repeat the old settings or choose another folder")


def _refuse_open_logs(states: dict[str, RunState]) -> None:
    """Raise DataError for a log that another program holds open for writing: it must neither be kept nor moved."""
    for state in states.values():
        if state.log.exists() and has_writer(state.log, unknown=False):
            raise DataError(
                f"{state.log} is open for writing in another program; close it there, then give the same command again"
            )


def _found(state: RunState) -> RunState:
    """The run as its log tells it; raises ConfigError for a log of another configuration."""
    if not state.log.exists():
        return dataclasses.replace(state, status="missing", run_uid="")
    try:
        with read_run(state.log) as run:
            header = run.header
            mark = fingerprint_of(header.configuration, header.seed, header.bench)
            if mark != state.fingerprint:
                raise ConfigError(
                    f"{state.log} was recorded under another configuration, seed or bench than this campaign's run "
                    f"'{state.name}'; move it away or choose another folder"
                )
            # killed between closing the log and writing its checksum: nothing vouches for what it holds
            unsealed = run.status == "complete" and not sidecar_of(state.log).exists()
            return dataclasses.replace(state, status="unsealed" if unsealed else run.status, run_uid=run.run_uid)
    except ReaderFailedError:  # on a busy machine, say: nothing that was measured is repeated for that
        raise
    except DataError:
        return dataclasses.replace(state, status="damaged", run_uid="")


def _set_aside(log: Path) -> None:
    """Give a log that did not complete, and its checksum, the first free name of its own."""
    if not log.exists():
        return
    count = 1
    while (aside := log.with_name(f"{log.stem}.partial-{count}.h5")).exists():
        count += 1
    sidecar = log.with_name(f"{log.name}.sha256")
    log.rename(aside)
    if sidecar.exists():
        sidecar.rename(aside.with_name(f"{aside.name}.sha256"))


def _play(
    plan: Plan,
    state: RunState,
    address: str,
    note: str,
    signals: Interrupts,
    report: Report | None,
    counted: Estimate,
) -> Outcome:
    kind, _ = bench_kind(address)
    # a repeatable bench gives the same data again, so the same configuration has the same name
    uid = state.fingerprint[:32] if kind.repeatable else None
    with contextlib.closing(open_bench(address, state.seed, state.disturbance)) as bench:
        return run_plan(
            plan,
            bench,
            state.log,
            seed=state.seed,
            report=report,
            run_uid=uid,
            interrupts=signals,
            counted=counted,
            note=note,
        )


def _write_state(
    home: Path, campaign: Campaign, whole: dict[str, str], status: str, states: dict[str, RunState]
) -> None:
    """Write the state file in one step: a reader sees the old one or the new one. Raises DataError if it cannot."""
    runs = [
        {"name": s.name, "plan": s.plan, "log": s.log.name, "seed": s.seed, "status": s.status, "run_uid": s.run_uid}
        for s in states.values()
    ]
    content = {
        "schema": STATE_SCHEMA,
        "campaign": msgspec.to_builtins(campaign),
        "fingerprint": whole,
        "status": status,
        "runs": runs,
    }
    try:
        write_text(home / STATE_FILE, json.dumps(content, indent=2) + "\n")
    except OSError as error:
        reason = f"{error.strerror}; check the folder, its rights and the free space"
        raise DataError(f"cannot write {home / STATE_FILE}: {reason}") from None
