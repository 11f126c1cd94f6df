"""Run the diagnosis on every case of a challenge, each in a process that gets the case's files and no more."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from pathlib import Path
from threading import Event, Timer
from typing import TypeVar

import msgspec

from analysis.challenge.plant import NOMINAL_ERROR
from analysis.challenge.truth import reveal
from campaigns.names import check_file_name
from campaigns.version import tool_commit, tool_version
from sim_backend.documents import json_of, read_text
from sim_backend.errors import ConfigError, DataError
from sim_backend.safe_write import folder_within, whole_file, write_text
from sim_backend.small_files import STATE_BYTES

RESULTS, OUTCOME, DIAGNOSIS = "results", "run.json", "diagnosis.json"

INTERRUPTED = 130

DIAGNOSE = (sys.executable, "-P", "-m", "mccdcli", "diagnose", "--no-page")
"""The command that is judged; the case's files and options follow. Pages of hundreds of cases take half of the time."""


T = TypeVar("T")
_RESTORE = "restore the file, or make the challenge anew"


class _Public(msgspec.Struct):
    """What is read of what a challenge tells of itself."""

    cases: list[str]
    nominal_error: float = NOMINAL_ERROR


@dataclass(frozen=True)
class Outcome:
    """How one diagnosis ended: exit code (None when it was stopped at the time limit), wall and processor seconds."""

    case: str
    exit_code: int | None
    wall_s: float
    cpu_s: float
    tool_version: str
    tool_commit: str


def run_challenge(
    folder: Path,
    *,
    jobs: int = 1,
    limit_s: float = 300.0,
    first: str | None = None,
    command: Sequence[str] = DIAGNOSE,
    report: Callable[[float, float, str], None] = lambda done, total, what: None,
) -> list[Outcome]:
    """Diagnose every case from the `first` on that has no outcome yet and return the outcomes of these, in order.

    For cases whose family is to be left out of the search, its name is read from the sealed truth and passed on as
    `--without`: that says what the answer is not. Raises ConfigError when `folder` holds no challenge, DataError when
    its truth was changed.
    """
    left_out = {
        name: [effect.effect for effect in case.effects]
        for name, case in reveal(folder).cases.items()
        if case.stratum == "outside"
    }
    cases = cases_of(folder, first)
    waiting = [name for name in cases if not was_run(folder, name)]
    work = _Work(folder, limit_s, tuple(command))
    with ThreadPoolExecutor(jobs) as pool:
        try:
            futures = [pool.submit(work.diagnose, name, left_out.get(name, [])) for name in waiting]
            for done, future in enumerate(as_completed(futures), start=1):
                report(done, len(waiting), f"case {future.result()}")
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            work.stop()
            raise
    return [outcome_of(folder, name) for name in cases]


def cases_of(folder: Path, first: str | None = None) -> list[str]:
    """Return the names of all cases from `first` on.

    Raises ConfigError when there is no challenge in `folder` or no such case.
    """
    names = _public(folder).cases
    if not names:
        raise DataError(f"{folder / 'challenge.json'} lists no cases; {_RESTORE}")
    for name in names:
        check_file_name(name, f"{folder / 'challenge.json'}: case")
    if first is not None and first not in names:
        raise ConfigError(f"{folder} has no case '{first}'; its cases are {names[0]} to {names[-1]}")
    return names if first is None else names[names.index(first) :]


def _public(folder: Path) -> _Public:
    path = folder / "challenge.json"
    text = read_text(path, "challenge", fix="make a challenge there first")
    return _as(_Public, json_of(text, str(path), error=DataError, fix=_RESTORE), path)


def _as(kind: type[T], content: object, path: Path) -> T:
    try:
        return msgspec.convert(content, kind)
    except msgspec.ValidationError as error:
        raise DataError(f"{path}: {error}; {_RESTORE}") from None


def nominal_error(folder: Path) -> float:
    """Return by what part numbers of nominal models are wrong at most: as the challenge states, or 3 %."""
    return _public(folder).nominal_error


def was_run(folder: Path, name: str) -> bool:
    """Tell whether a case has an outcome."""
    return (folder / RESULTS / name / OUTCOME).is_file()


def outcome_of(folder: Path, name: str) -> Outcome:
    """Return the outcome of a case; raises ConfigError when it has not been run."""
    path = folder / RESULTS / name / OUTCOME
    if not was_run(folder, name):
        raise ConfigError(f"case {name} of {folder} has no outcome yet: run the challenge to its end first")
    text = read_text(path, "outcome", most_bytes=STATE_BYTES, error=DataError)
    return _as(Outcome, json_of(text, str(path), error=DataError, fix=_RESTORE), path)


def diagnosed_by(folder: Path, names: Sequence[str]) -> str:
    """Return version and commit of the tool that diagnosed these cases: what a score is of, whoever scores it."""
    outcomes = [outcome_of(folder, name) for name in names]
    return tools([(o.tool_version, o.tool_commit) for o in outcomes])


def tools(versions: Sequence[tuple[str, str]]) -> str:
    """Return several (version, commit) of the tool in words, each once."""
    return " and ".join(dict.fromkeys(f"{version} (commit {commit})" for version, commit in versions))


@dataclass
class _Work:
    """The diagnoses of one run: those under way, and whether they are being stopped."""

    folder: Path
    limit_s: float
    command: tuple[str, ...]
    running: set[subprocess.Popen[bytes]] = field(default_factory=set)
    stopping: Event = field(default_factory=Event)

    def stop(self) -> None:
        """Stop what runs and let it leave no outcome."""
        self.stopping.set()
        for process in tuple(self.running):
            process.kill()

    def diagnose(self, name: str, left_out: list[str]) -> str:
        """Run one diagnosis in its case's folder, its output kept beside its result; return the case's name.

        How far the nominal model can be trusted is public: uniform within ±3 %, a standard deviation of 3 %/√3, or
        what the challenge states. One that was stopped leaves no outcome, so that it is run again.
        """
        case = (self.folder / "cases" / name).resolve()
        out = folder_within(folder_within(self.folder, RESULTS), name).resolve()
        runs = sorted(p.name for p in case.glob("run-*.h5"))
        without = [word for slug in left_out for word in ("--without", slug)]
        tolerance = ["--nominal-tolerance", f"{100.0 * nominal_error(self.folder) / 3.0**0.5:.2f}%"]
        arguments = [*self.command, *runs, "--model", "nominal.toml", "-o", str(out), *tolerance, *without]
        started = time.monotonic()
        with whole_file(out / "words.txt") as words:
            process = subprocess.Popen(arguments, cwd=case, stdout=words, stderr=words)
            self.running.add(process)
            code, cpu_s = _await(process, self.limit_s)
            self.running.discard(process)
        if self.stopping.is_set() or code == INTERRUPTED:
            return name
        outcome = Outcome(name, code, time.monotonic() - started, cpu_s, tool_version(), tool_commit())
        write_text(out / OUTCOME, json.dumps(asdict(outcome), indent=1) + "\n")
        return name


def _await(process: subprocess.Popen[bytes], limit_s: float) -> tuple[int | None, float]:
    """Return exit code (None when it took longer than `limit_s` and was stopped) and processor seconds."""
    late: list[bool] = []

    def stop() -> None:
        late.append(True)
        process.kill()

    timer = Timer(limit_s, stop)
    timer.start()
    try:
        _, status, usage = os.wait4(process.pid, 0)
    finally:
        timer.cancel()
    process.returncode = os.waitstatus_to_exitcode(status)  # wait4 has taken it, so Popen cannot ask again
    return (None if late else process.returncode), usage.ru_utime + usage.ru_stime
