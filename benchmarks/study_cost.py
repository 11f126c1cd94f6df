"""What a study costs: time and memory per trial, and how they grow with trials and workers, on either engine.

    python -m benchmarks.study_cost

Every number comes from a process of its own: `mccd study` on the studies of the documents with more or fewer trials,
a scheduler and workers on this machine, and the book-keeping alone with trials that were made up. The bytes of all runs
of one study are compared. Exit code 1 if two of them differ.
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
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory

from campaigns.version import tool_commit, tool_version

ROOT = Path(__file__).parents[1]
FILES = ("trials.csv", "study.json", "study.svg")
ENVIRONMENT = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
PATIENCE_S = 60.0


def measured(command: list[str]) -> tuple[dict[str, float], str]:
    """Run a command and return its wall and processor seconds and peak memory in MB, and what it printed."""
    started = time.monotonic()
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
    }, printed


def studied(name: str, draws: int, home: Path, *options: str) -> dict[str, object]:
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
        "bytes_per_trial": {p.name: round(p.stat().st_size / trials, 1) for p in sorted(folder.iterdir())},
        "sha256": digest,
    }


@contextmanager
def a_cluster(workers: int, home: Path) -> Iterator[tuple[str, list[int]]]:
    """Give the address of a scheduler with so many workers of one thread, and the process ids, the scheduler first."""
    file = home / f"scheduler-{time.monotonic_ns()}.json"
    quiet = {"cwd": ROOT, "env": ENVIRONMENT, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    place = ["--host", "127.0.0.1", "--no-dashboard"]
    own = ["--port", "0", "--no-show", "--scheduler-file", str(file)]
    tool = [sys.executable, "-m"]
    started = [subprocess.Popen([*tool, "distributed.cli.dask_scheduler", *place, *own], **quiet)]  # type: ignore[call-overload]
    try:
        address = ""
        for _ in range(int(PATIENCE_S / 0.05)):
            if file.exists() and (text := file.read_text()):
                address = json.loads(text)["address"]
                break
            time.sleep(0.05)
        for i in range(workers):
            more = ["--nthreads", "1", "--no-nanny", "--local-directory", str(home / f"worker-{i}")]
            command = [*tool, "distributed.cli.dask_worker", address, *place, *more]
            started.append(subprocess.Popen(command, **quiet))  # type: ignore[call-overload]
        time.sleep(6.0)
        yield address, [process.pid for process in started]
    finally:
        for process in started:
            process.kill()
            process.wait()


def peak_mb(pid: int) -> float:
    """Return the largest memory that a process has had so far."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return round(int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1024.0, 1)


def best(name: str, draws: int, repeats: int, home: Path, *options: str) -> dict[str, object]:
    """Run a study so often and return the cost of the fastest: what other programs take of the machine only slows."""
    runs = [studied(name, draws, home, *options) for _ in range(repeats)]
    fastest = max(runs, key=lambda run: run["trials_per_s"])  # type: ignore[arg-type, return-value]
    same_bytes = len({run["sha256"] for run in runs}) == 1
    rates = [run["trials_per_s"] for run in runs]
    return {**fastest, "sha256": fastest["sha256"] if same_bytes else "differs", "rates": rates}


def on_cluster(name: str, draws: int, repeats: int, workers: int, home: Path) -> dict[str, object]:
    """Run a study on a new cluster and return what it cost, the memory of its processes included."""
    with a_cluster(workers, home) as (address, pids):
        warm = studied(name, 2, home, "--cluster", address)  # the first trials load compiled code
        cost = best(name, draws, repeats, home, "--cluster", address)
        memory = [peak_mb(pid) for pid in pids]
    return {
        "workers": workers,
        **cost,
        "first_trials_per_s": warm["trials_per_s"],
        "scheduler_peak_mb": memory[0],
        "worker_peak_mb": max(memory[1:]),
    }


EMPTY = """
import json, sys, time
from distributed import Client
from analysis.study.engines import Engine
client = Client(sys.argv[1], timeout=10.0, set_as_default=False)
executor = client.get_executor(pure=False)
engine = Engine(lambda trial: executor.submit(abs, trial), lambda: int(sys.argv[2]))
list(engine.outcomes(iter(range(100))))
started = time.perf_counter()
done = sum(len(batch) for batch in engine.outcomes(iter(range(100, 2100))))
print(json.dumps({"trials": done, "trials_per_s": round(done / (time.perf_counter() - started), 1)}))
client.close()
"""


def dispatch(workers: int, home: Path) -> dict[str, object]:
    """Send trials that do nothing to a cluster: what scheduler and client take for each."""
    with a_cluster(workers, home) as (address, _):
        cost, printed = measured(["-c", EMPTY, address, str(workers)])
    return {"workers": workers, **json.loads(printed), "client_cpu_s": cost["cpu_s"]}


MADE_UP = """
import sys, time
from pathlib import Path
import numpy as np
from analysis.study.definition import load_study
from analysis.study.fingerprint import fingerprint
from analysis.study.output import write_results
from analysis.study.store import Store
from analysis.study.summary import summarise
from analysis.study.trial import Job, Outcome
import msgspec, json
file, folder, n, batch = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
study = msgspec.structs.replace(load_study(file), trials=n // 2)
job = Job.of(study)
rng = np.random.default_rng(0)
store = Store(folder, fingerprint(job), job.varied_names, job.columns, resume=False)
started = time.perf_counter()
for first in range(0, n, batch):
    made = []
    for t in range(first, first + batch):
        numbers = rng.random(len(job.varied_names) + len(job.columns)).tolist()
        cut = len(job.varied_names)
        made.append(Outcome(t, "done", "", tuple(numbers[:cut]), tuple(numbers[cut:]), 0.1))
    store.add(made)
kept = time.perf_counter()
summary = summarise(job, store)
write_results(job, store, summary, folder)
ended = time.perf_counter()
store.close()
print(json.dumps({"keep_s": kept - started, "conclude_s": ended - kept}))
"""


def book_keeping(n: int, batch: int, home: Path) -> dict[str, object]:
    """Keep and conclude a study of `n` trials that were made up, `batch` of them finishing at once."""
    folder = home / f"made-up-{n}-{batch}"
    file = str(ROOT / "docs" / "examples" / "spread.toml")
    cost, printed = measured(["-c", MADE_UP, file, str(folder), str(n), str(batch)])
    took = json.loads(printed)
    return {
        "trials": n,
        "finishing_at_once": batch,
        **cost,
        "keep_ms_per_trial": round(1e3 * took["keep_s"] / n, 4),
        "conclude_s": round(took["conclude_s"], 2),
        "bytes_per_trial": {p.name: round(p.stat().st_size / n, 1) for p in sorted(folder.iterdir())},
    }


def same(rows: list[dict[str, object]]) -> bool:
    """Tell whether all runs of one study with one number of trials gave the same bytes."""
    digests: dict[object, set[object]] = {}
    for row in rows:
        digests.setdefault((row["study"], row["trials"]), set()).add(row["sha256"])
    return all(len(found) == 1 for found in digests.values())


def main(arguments: list[str] | None = None) -> int:
    """Measure everything and write the result."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    now = datetime.now(UTC)
    usual = Path(__file__).parent / "results" / f"study-cost-{now:%Y-%m-%d}.json"
    parser.add_argument("--out", type=Path, default=usual)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2, 4])
    given = parser.parse_args(arguments)
    with TemporaryDirectory() as folder:
        home = Path(folder)
        studied("spread", 2, home, "--workers", "1")  # compiles what is not compiled yet
        trials = [studied("spread", draws, home, "--workers", "1") for draws in (10, 100, 1000)]
        threads = [{"workers": n, **best("spread", 100, 3, home, "--workers", str(n))} for n in given.workers]
        threads += [{"workers": n, **best("power", 2, 1, home, "--workers", str(n))} for n in given.workers]
        clusters = [on_cluster("spread", 100, 3, n, home) for n in given.workers]
        clusters += [on_cluster("power", 2, 1, n, home) for n in given.workers[-1:]]
        empty = [dispatch(n, home) for n in given.workers]
        keeping = [book_keeping(10_000, 1, home), book_keeping(10_000, 4, home)]
        keeping += [book_keeping(n, 1000, home) for n in (10_000, 100_000, 1_000_000)]
    equal = same([*trials, *threads, *clusters])
    result = {
        "date_utc": f"{now:%Y-%m-%d}",
        "command": "python -m benchmarks.study_cost",
        "mccd": f"{tool_version()} ({tool_commit()})",
        "python": platform.python_version(),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the end",
        "same_bytes": equal,
        "growth_with_trials": trials,
        "threads": threads,
        "cluster": clusters,
        "trials_that_do_nothing": empty,
        "book_keeping": keeping,
    }
    given.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    print(given.out, "the same bytes" if equal else "DIFFERENT bytes")
    return 0 if equal else 1


if __name__ == "__main__":
    raise SystemExit(main())
