"""Kill a campaign with `kill -9` at random moments, resume it, and kill it again, until it is complete; many times.

    python -m benchmarks.soak_campaign --kills 200 --workers 2

After every kill each log must open, hold rows that are those of an uninterrupted campaign bit for bit, and be
recoverable; complete logs must pass `verify` and never change again; nothing may be overwritten. A campaign that is
complete in the end must equal the uninterrupted one. Every fourth campaign runs on the emulated bench, whose process
must end with its killed parent. Sources and models must not change meanwhile: run it in a copy of its own.
Exit code 1 if a single promise is broken.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import os
import platform
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from campaigns.log import Run, read_run, recover, sidecar_of, verify
from campaigns.version import tool_commit, tool_version
from sim_backend.errors import MccdError

CAMPAIGN = "quick"
SEED = 5
END_S = 120.0
MARK = "MCCD_SOAK_FOLDER"


@dataclass
class Tally:
    """What one campaign went through, from its first start to its completion."""

    bench: str
    kills: int = 0
    partial_logs: int = 0
    rows_checked: int = 0
    unsealed: int = 0
    statuses: Counter[str] = field(default_factory=Counter)
    broken: list[str] = field(default_factory=list)


def start(folder: Path, bench: str, *, resume: bool) -> subprocess.Popen[bytes]:
    """Start the command as a user would."""
    command = [sys.executable, "-m", "mccdcli", "campaign", "run", CAMPAIGN]
    command += ["--bench", bench, "--out", str(folder), "--seed", str(SEED), *(["--resume"] if resume else [])]
    environment = os.environ | {MARK: str(folder)}  # which the emulated bench's process inherits
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=environment)


def torture(number: int, reference: Path, run_s: float) -> Tally:
    """Kill and resume one campaign until it is complete."""
    bench = "emulator" if number % 4 == 3 else "sim"
    rng, tally = np.random.default_rng([SEED, number]), Tally(bench)
    with TemporaryDirectory(prefix="mccd-soak-") as temporary:
        folder = Path(temporary) / "campaign"
        sealed: dict[str, str] = {}
        while True:
            process = start(folder, bench, resume=folder.exists())
            longest_s = run_s * (1.0 if bench == "emulator" else 0.2)  # it starts a process per run
            ended = _killed(process, folder, float(rng.uniform(0.0, longest_s)))
            if not ended:
                tally.kills += 1
            _inspect(folder, reference, sealed, tally)
            if ended:
                if process.returncode != 0:
                    tally.broken.append(f"exit code {process.returncode}: {_last_words(process)}")
                break
        if process.returncode == 0:
            _compare_whole(folder, reference, tally)
        if _orphans(folder):
            tally.broken.append("a process of the killed campaign lives on")
    return tally


def _killed(process: subprocess.Popen[bytes], folder: Path, after_s: float) -> bool:
    """Kill a process some time after it has begun on the folder; return True if it ended by itself before."""
    end_s = time.monotonic() + END_S
    began = set(folder.glob("*")) if folder.exists() else set()
    while process.poll() is None and time.monotonic() < end_s:
        if folder.exists() and set(folder.glob("*")) != began:
            break
        time.sleep(0.002)
    try:
        process.wait(after_s)
        return True
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return False


def _inspect(folder: Path, reference: Path, sealed: dict[str, str], tally: Tally) -> None:
    """Check everything that a kill left behind."""
    for path in sorted(folder.glob("*.h5")):
        try:
            with read_run(path) as run, read_run(reference / f"{path.name.partition('.')[0]}.h5") as whole:
                status = run.status
                tally.statuses[status] += 1
                tally.rows_checked += run.rows
                if not _is_start_of(run, whole):
                    tally.broken.append(f"{path.name}: its samples are not those of an uninterrupted run")
                rows = run.rows
        except MccdError as error:
            tally.broken.append(f"{path.name} cannot be read: {error}")
            continue
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        if status == "complete" and not sidecar_of(path).exists():
            tally.unsealed += 1  # killed between closing and the checksum: it is played again
            continue
        if status == "complete" or "partial" in path.name:
            if sealed.setdefault(path.name, digest) != digest:
                tally.broken.append(f"{path.name}: changed after it was complete or set aside")
        if status == "complete":
            if not verify(path).ok:
                tally.broken.append(f"{path.name}: complete, and does not verify")
        elif rows:
            _recover(path, rows, tally)


def _recover(path: Path, rows: int, tally: Tally) -> None:
    with TemporaryDirectory(prefix="mccd-soak-") as folder:
        saved = recover(path, Path(folder) / path.name)
        if saved.rows != rows or not verify(saved.path).ok:
            tally.broken.append(f"{path.name}: {saved.rows} of {rows} samples recovered")


def _is_start_of(run: Run, whole: Run) -> bool:
    return run.rows <= whole.rows and all(
        run.read(name).tobytes() == whole.read(name)[: run.rows].tobytes() for name in run.channels
    )


def _compare_whole(folder: Path, reference: Path, tally: Tally) -> None:
    tally.partial_logs = len(list(folder.glob("*.partial-*.h5")))
    for path in sorted(reference.glob("*.h5")):
        with read_run(folder / path.name) as run, read_run(path) as whole:
            same = run.status == "complete" and run.rows == whole.rows and run.segments == whole.segments
            if not (same and _is_start_of(run, whole) and verify(run.path).ok):
                tally.broken.append(f"{path.name}: differs from the uninterrupted campaign's")


def _orphans(folder: Path) -> bool:
    """Whether an emulated bench outlives its parent by more than the time to make itself safe."""
    end_s = time.monotonic() + 10.0
    while time.monotonic() < end_s:
        mine = [p for p in Path("/proc").glob("[0-9]*/environ") if _names(p, folder)]
        if not mine:
            return False
        time.sleep(0.1)
    return True


def _names(environ: Path, folder: Path) -> bool:
    try:
        return environ.parent.name != str(os.getpid()) and f"{MARK}={folder}".encode() in environ.read_bytes()
    except OSError:
        return False


def _last_words(process: subprocess.Popen[bytes]) -> str:
    return "" if process.stderr is None else process.stderr.read().decode(errors="replace")[-300:]


def summary(code: str, tallies: list[Tally]) -> dict[str, object]:
    """Count what happened."""
    statuses: Counter[str] = sum((tally.statuses for tally in tallies), Counter())
    return {
        "mccd": code,
        "machine": f"Python {platform.python_version()}, {platform.system()} {platform.machine()}",
        "command": " ".join(["python -m benchmarks.soak_campaign", *sys.argv[1:]]),
        "kills": sum(tally.kills for tally in tallies),
        "campaigns_completed": dict(Counter(tally.bench for tally in tallies)),
        "logs_found_after_kills": dict(statuses),
        "rows_compared_bit_for_bit": sum(tally.rows_checked for tally in tallies),
        "partial_logs_set_aside": sum(tally.partial_logs for tally in tallies),
        "closed_without_checksum": sum(tally.unsealed for tally in tallies),
        "broken": [line for tally in tallies for line in tally.broken],
    }


def main() -> int:
    """Run the soak and write its result after every batch, so that a soak that is stopped counts as far as it got."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / f"campaign-soak-{datetime.now(UTC):%Y-%m-%d}.json"
    code, tallies = f"{tool_version()} (commit {tool_commit()})", list[Tally]()
    with TemporaryDirectory(prefix="mccd-soak-") as folder:
        reference = Path(folder) / "reference"
        for attempt in range(2):  # the first may compile
            started_s = time.monotonic()
            process = start(reference if attempt else Path(folder) / "first", "sim", resume=False)
            if process.wait(END_S):
                raise SystemExit(_last_words(process))
            run_s = time.monotonic() - started_s
        with multiprocessing.get_context("fork").Pool(options.workers) as pool:
            play = partial(torture, reference=reference, run_s=run_s)
            while sum(tally.kills for tally in tallies) < options.kills:
                batch = range(len(tallies), len(tallies) + options.workers)
                for tally in pool.imap_unordered(play, batch):
                    tallies.append(tally)
                    print(tally, file=sys.stderr, flush=True)
                path.write_text(json.dumps(summary(code, tallies), indent=2) + "\n", encoding="utf-8")
    print(path.read_text(encoding="utf-8"))
    return 1 if any(tally.broken for tally in tallies) else 0


if __name__ == "__main__":
    sys.exit(main())
