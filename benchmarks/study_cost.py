"""What a study costs: time and memory per trial, and how they grow with trials and workers, on either engine.

    python -m benchmarks.study_cost                              all parts, on an idle machine
    python -m benchmarks.study_cost --parts shares               where the time of one trial goes
    python -m benchmarks.study_cost --nothing 1000 10000 100000  more of the trials that do nothing

Every number comes from a process of its own: `mccd study` on the studies of the documents with more or fewer trials,
a scheduler and workers on this machine, trials that do nothing, and the book-keeping alone with trials that were made
up. The bytes of all runs of one study are compared. Exit code 1 if two of them differ.
`python -m benchmarks.study_plan RESULT.json` plans a million trials on paper from what is written here.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from campaigns.version import tool_commit, tool_version

ROOT = Path(__file__).parents[1]
FILES = ("trials.csv", "study.json", "study.svg")
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
ENVIRONMENT = os.environ | ONE_THREAD | {"PYTHONPATH": str(ROOT)}
TRIALS, NOTHING = "benchmarks.study_trials", "benchmarks.study_nothing"
PARTS = ("shares", "trials", "threads", "cluster", "nothing", "keeping")
PATIENCE_S = 60.0

Row = dict[str, Any]


@dataclass(frozen=True)
class Sizes:
    """How much is measured: `workers` of either engine, draws of *spread* and *power*, runs of each, and trials."""

    workers: Sequence[int] = (1, 2, 4)
    growth: Sequence[int] = (10, 100, 1000)
    spread: int = 100
    power: int = 2
    repeats: int = 3
    shares: int = 100
    nothing: Sequence[int] = (1_000, 10_000)
    keeping: Sequence[tuple[int, int]] = ((10_000, 1), (10_000, 4), (10_000, 1000), (100_000, 1000), (1_000_000, 1000))


def measured(command: list[str]) -> tuple[Row, str]:
    """Run a command and return its wall and processor seconds, peak memory in MB and the load, and what it printed."""
    load, started = os.getloadavg()[0], time.monotonic()
    process = subprocess.Popen([sys.executable, *command], cwd=ROOT, env=ENVIRONMENT, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    printed = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.stdout.close()
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} ended with {process.returncode}")
    return {
        "wall_s": round(time.monotonic() - started, 3),
        "cpu_s": round(usage.ru_utime + usage.ru_stime, 3),
        "peak_mb": round(usage.ru_maxrss / 1024.0, 1),
        "load_1min": [round(load, 2), round(os.getloadavg()[0], 2)],
    }, printed


def studied(name: str, draws: int, home: Path, *options: str) -> Row:
    """Run a study of the documents with this many draws and return what it cost, with a digest of its results."""
    text = (ROOT / "docs" / "examples" / f"{name}.toml").read_text(encoding="utf-8")
    lines = [f"trials = {draws}" if line.startswith("trials =") else line for line in text.splitlines()]
    file, folder = home / f"{name}.toml", home / f"{name}-{time.monotonic_ns()}"
    file.write_text("\n".join(lines), encoding="utf-8")
    cost, printed = measured(["-m", "mccdcli", "study", str(file), "-o", str(folder), "--json", *options])
    found = json.loads(printed)
    trials, wall_s = found["timing"]["trials"], found["timing"]["wall_s"]
    digest = hashlib.sha256(b"".join((folder / one).read_bytes() for one in FILES)).hexdigest()
    return {
        "study": name,
        "trials": trials,
        **cost,
        "trials_wall_s": round(wall_s, 3),
        "trials_per_s": round(trials / wall_s, 2),
        "mean_trial_s": round(found["timing"]["trial_s"], 5),
        "bytes_per_trial": bytes_per_trial(folder, trials),
        "sha256": digest,
    }


def bytes_per_trial(folder: Path, trials: int) -> dict[str, float]:
    """Return the size of every file of a study over its trials."""
    return {p.name: round(p.stat().st_size / trials, 1) for p in sorted(folder.iterdir())}


@contextmanager
def a_cluster(workers: int, home: Path, *load: str) -> Iterator[tuple[str, list[int]]]:
    """Give the address of a scheduler with so many workers of one thread, and the process ids, the scheduler first.

    The workers `load` these modules.
    """
    file = home / f"scheduler-{time.monotonic_ns()}.json"
    quiet = {"cwd": ROOT, "env": ENVIRONMENT, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    place = ["--host", "127.0.0.1", "--no-dashboard"]
    own = ["--port", "0", "--no-show", "--scheduler-file", str(file)]
    tool = [sys.executable, "-m"]
    started = [subprocess.Popen([*tool, "distributed.cli.dask_scheduler", *place, *own], **quiet)]  # type: ignore[call-overload]
    try:
        address = _address(file)
        for i in range(workers):
            more = [
                "--nthreads",
                "1",
                "--no-nanny",
                "--preload",
                TRIALS,
                "--local-directory",
                str(home / f"worker-{i}"),
            ]
            command = [*tool, "distributed.cli.dask_worker", address, *place, *more]
            started.append(subprocess.Popen(command, **quiet))  # type: ignore[call-overload]
        measured(["-m", TRIALS, "wait", address, str(workers)])
        yield address, [process.pid for process in started]
    finally:
        for process in started:
            process.kill()
            process.wait()


def _address(file: Path) -> str:
    for _ in range(int(PATIENCE_S / 0.05)):
        if file.exists() and (text := file.read_text()):
            return str(json.loads(text)["address"])
        time.sleep(0.05)
    raise SystemExit(f"no scheduler started within {PATIENCE_S:g} s; is dask.distributed installed?")


def peak_mb(pid: int) -> float:
    """Return the largest memory that a process has had so far."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return round(int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1024.0, 1)


def peaks(pids: list[int]) -> Row:
    """Return the largest memory of the scheduler and of any worker so far."""
    scheduler, *workers = map(peak_mb, pids)
    return {"scheduler_peak_mb": scheduler, "worker_peak_mb": max(workers)}


def best(name: str, draws: int, repeats: int, home: Path, *options: str) -> Row:
    """Run a study so often and return the cost of the fastest: what other programs take of the machine only slows."""
    runs = [studied(name, draws, home, *options) for _ in range(repeats)]
    fastest = max(runs, key=lambda run: run["trials_per_s"])
    same_bytes = len({run["sha256"] for run in runs}) == 1
    rates = [run["trials_per_s"] for run in runs]
    return {**fastest, "sha256": fastest["sha256"] if same_bytes else "differs", "rates": rates}


def on_cluster(name: str, draws: int, repeats: int, workers: int, home: Path) -> Row:
    """Run a study on a new cluster and return what it cost, the memory of its processes included."""
    with a_cluster(workers, home) as (address, pids):
        warm = studied(name, 2, home, "--cluster", address)  # the first trials load compiled code
        cost = best(name, draws, repeats, home, "--cluster", address)
        memory = peaks(pids)
    return {"workers": workers, **cost, "first_trials_per_s": warm["trials_per_s"], **memory}


def both_shares(trials: int, repeats: int) -> Row:
    """Return the stages of a trial with and without the memory that trials keep, of so many runs each the fastest.

    The runs take turns, so that what other programs take of the machine meets both.
    """
    found: Row = {}
    for _ in range(repeats):
        for key, more in (("shares", []), ("shares_giving_memory_back", ["--give-back"])):
            cost, printed = measured(["-m", TRIALS, "shares", str(trials), *more])
            row = {**json.loads(printed), **cost}
            found[key] = min(found.get(key, row), row, key=lambda one: one["trial_ms"])
    return found


def nothing_in_threads(trials: int, workers: int, home: Path) -> Row:
    """Run a study of trials that do nothing in threads: what the loop and the disk take for each."""
    folder = home / f"nothing-{time.monotonic_ns()}"
    cost, printed = measured(["-m", TRIALS, "nothing", str(folder), str(trials), "--workers", str(workers)])
    size = bytes_per_trial(folder, trials)
    return {"engine": "threads", "workers": workers, **json.loads(printed), **cost, "bytes_per_trial": size}


def nothing_on_cluster(trials: Sequence[int], workers: int, home: Path) -> list[Row]:
    """Run studies of trials that do nothing on one cluster each: what scheduler, client and disk take for each."""
    rows = []
    for n in trials:
        folder = home / f"nothing-{time.monotonic_ns()}"
        with a_cluster(workers, home, NOTHING) as (address, pids):
            measured(["-m", TRIALS, "nothing", f"{folder}-first", "100", "--cluster", address])  # what is loaded once
            cost, printed = measured(["-m", TRIALS, "nothing", str(folder), str(n), "--cluster", address])
            memory = peaks(pids)
        size = bytes_per_trial(folder, n)
        row = {"engine": "cluster", "workers": workers, **json.loads(printed), **cost, **memory}
        rows.append({**row, "bytes_per_trial": size})
    return rows


def book_keeping(n: int, batch: int, home: Path) -> Row:
    """Keep and conclude a study of `n` trials that were made up, `batch` of them finishing at once."""
    folder = home / f"made-up-{n}-{batch}"
    cost, printed = measured(["-m", TRIALS, "made-up", str(folder), str(n), str(batch)])
    took = json.loads(printed)
    return {
        "trials": n,
        "finishing_at_once": batch,
        **cost,
        "keep_ms_per_trial": round(1e3 * took["keep_s"] / n, 4),
        "conclude_s": round(took["conclude_s"], 2),
        "bytes_per_trial": bytes_per_trial(folder, n),
    }


def same(rows: list[Row]) -> bool:
    """Tell whether all runs of one study with one number of trials gave the same bytes."""
    digests: dict[object, set[object]] = {}
    for row in rows:
        digests.setdefault((row["study"], row["trials"]), set()).add(row["sha256"])
    return all(len(found) == 1 for found in digests.values())


def measure(parts: Sequence[str], sizes: Sizes, home: Path) -> Row:
    """Return what each part found, by its key in the result."""
    found: Row = {}
    if {"trials", "threads", "cluster"} & set(parts):
        studied("spread", 2, home, "--workers", "1")  # compiles what is not compiled yet
    if "shares" in parts:
        found |= both_shares(sizes.shares, sizes.repeats)
    if "trials" in parts:
        found["growth_with_trials"] = [studied("spread", n, home, "--workers", "1") for n in sizes.growth]
    if "threads" in parts:
        found["threads"] = [
            {"workers": n, **best(name, draws, repeats, home, "--workers", str(n))}
            for name, draws, repeats in (("spread", sizes.spread, sizes.repeats), ("power", sizes.power, 1))
            for n in sizes.workers
        ]
    if "cluster" in parts:
        clusters = [on_cluster("spread", sizes.spread, sizes.repeats, n, home) for n in sizes.workers]
        found["cluster"] = [*clusters, on_cluster("power", sizes.power, 1, sizes.workers[-1], home)]
    if "nothing" in parts:
        rows = [nothing_in_threads(n, workers, home) for workers in sizes.workers for n in sizes.nothing]
        rows += [row for workers in sizes.workers for row in nothing_on_cluster(sizes.nothing, workers, home)]
        found["trials_that_do_nothing"] = rows
    if "keeping" in parts:
        found["book_keeping"] = [book_keeping(n, batch, home) for n, batch in sizes.keeping]
    return found


def main(arguments: list[str] | None = None) -> int:
    """Measure what is asked for and write the result."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    now = datetime.now(UTC)
    parser.add_argument("--out", type=Path, help="else benchmarks/results/study-cost-DATE.json, or named by the parts")
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--workers", type=int, nargs="+", default=Sizes.workers)
    parser.add_argument("--nothing", type=int, nargs="+", default=Sizes.nothing, help="trials that do nothing")
    parser.add_argument("--commit", default=tool_commit(), help="of the sources, where they are no checkout")
    given = parser.parse_args(arguments)
    if given.commit == "unknown":
        parser.error("these sources are no checkout: name their --commit, or nobody can tell what was measured")
    load = os.getloadavg()
    with TemporaryDirectory() as folder:
        found = measure(given.parts, Sizes(workers=given.workers, nothing=given.nothing), Path(folder))
    equal = same([row for key in ("growth_with_trials", "threads", "cluster") for row in found.get(key, [])])
    result = {
        "date_utc": f"{now:%Y-%m-%d}",
        "command": " ".join(["python -m benchmarks.study_cost", *(sys.argv[1:] if arguments is None else arguments)]),
        "mccd": tool_version(),
        "commit": given.commit,
        "python": platform.python_version(),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "load_average": {"before": load, "after": os.getloadavg()},
        "same_bytes": equal,
        **found,
    }
    what = "cost" if set(given.parts) == set(PARTS) else "-".join(given.parts)
    out = given.out or Path(__file__).parent / "results" / f"study-{what}-{now:%Y-%m-%d}.json"
    out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    print(out, "the same bytes" if equal else "DIFFERENT bytes")
    return 0 if equal else 1


if __name__ == "__main__":
    raise SystemExit(main())
