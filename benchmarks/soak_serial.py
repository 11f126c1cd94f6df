"""Play segments over damaged lines, seed after seed: right data or a clear error, in time, and the bench safe.

    python -m benchmarks.soak_serial --seeds 1000 --workers 4

Every seed draws its faults (campaigns/serial/faults.py), its transport (pty or TCP) and its segments; it has an
emulated bench in a process of its own. The record is compared bit for bit with that of the same bench played
directly. Sources and models must not change meanwhile: run it in a copy of its own.
Exit code 1 if a single seed breaks a promise. The result goes to benchmarks/results/.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import json
import multiprocessing
import os
import platform
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from campaigns.benches import open_bench
from campaigns.serial import SerialBench, ServeOptions, transport_at
from campaigns.serial.emulator import PTY_BAUD
from campaigns.serial.faults import KINDS, drawn_spec
from campaigns.serial.serve import serve
from campaigns.version import tool_commit, tool_version
from sim_backend.bench import Gate, Learning, Segment
from sim_backend.control.blocks import filter_from_zpk
from sim_backend.errors import ConfigError, HardwareError

WATCHDOGS_S = (2.0, 5.0)
STALL_S = 4.0
BOUND_S = 440.0
"""Opening, three steps for each of two segments, and the safe state are limited to 15 s each; each may overrun by one
attempt: 5 s to reopen the line, 6 s to lock the bench, 1 s to ask. That is 8 × 27 s. For each segment two transfers of
at most 19 and 422 blocks may take 0.25 s per block more, and 4 s for all their bytes."""


@dataclass(frozen=True)
class Outcome:
    """What became of one seed; `broken` names the promise that was not kept, if one was not."""

    seed: int
    transport: str
    faults: str
    struck: str
    result: str
    message: str
    retries: int
    seconds: float
    broken: str


def segments(seed: int, names: tuple[str, ...], rate_hz: float) -> list[Segment]:
    """Return two segments: an open-loop period, then a closed loop with gates and learning."""
    rng = np.random.default_rng([seed, 9])
    period = int(rng.integers(50, 400))
    wave = 1e-4 * rng.standard_normal((period, 3))
    record = tuple(str(n) for n in names if rng.random() < 0.4) or names[:1]
    pi = filter_from_zpk([0.99], [1.0], 1e-3, rate_hz)
    low = filter_from_zpk([-1.0], [0.5], 0.1, rate_hz)
    return [
        Segment("open", int(rng.integers(200, 3000)), np.zeros_like(wave), wave, record=record),
        Segment(
            "closed",
            int(rng.integers(200, 3000)),
            0.1 * wave,
            wave,
            feedback=(pi, None, pi),
            gates=(Gate(3, 0, True, 1e-6), Gate(7, 2, True)),
            learning=(None, Learning(low, 0.1, 2, period, (0.25, 0.5, 0.25)), None),
            record=record,
        ),
    ]


@contextlib.contextmanager
def emulator(seed: int, transport: str, faults: str, journal: Path) -> Iterator[str]:
    """Fork a process that serves the bench; yield its address. It ends when the pipe to it does."""
    life_read, life_write = os.pipe()
    say_read, say_write = os.pipe()
    child = os.fork()
    if child == 0:
        _serve_forked(seed, transport, faults, journal, (life_read, life_write), (say_read, say_write))
    os.close(life_read)
    os.close(say_write)
    try:
        with os.fdopen(say_read) as said:
            yield said.readline().strip()
    finally:
        os.close(life_write)
        _reap(child, 30.0)


def _serve_forked(
    seed: int, transport: str, faults: str, journal: Path, life: tuple[int, int], say: tuple[int, int]
) -> None:
    os.close(life[1])
    os.close(say[0])
    sys.stdin = os.fdopen(life[0])
    status = 1
    try:
        with journal.open("a", buffering=1) as file:
            serve(
                ServeOptions(seed=seed, transport="tcp" if transport == "tcp" else "pty", faults=faults, lifeline=True),
                open_bench,
                lambda line: os.write(say[1], f"{line}\n".encode()) and None,
                lambda line: file.write(f"{line}\n") and None,
            )
        status = 0
    finally:
        os._exit(status)


def _reap(child: int, timeout_s: float) -> None:
    end_s = time.monotonic() + timeout_s
    while os.waitpid(child, os.WNOHANG) == (0, 0):
        if time.monotonic() > end_s:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            raise RuntimeError(f"the emulated bench {child} did not end within {timeout_s:g} s")
        time.sleep(0.005)


def run_seed(seed: int) -> Outcome:
    """Play one seed and judge it."""
    transport = ("pty", "tcp")[seed % 2]
    watchdog_s = WATCHDOGS_S[seed // 2 % 2]
    rates = {kind: getattr(drawn_spec(seed), kind) for kind in KINDS}
    faults = " ".join(f"{kind}={rate:.1e}" for kind, rate in rates.items() if rate)
    direct = open_bench("sim", seed)
    rate_hz = direct.signals[0].sample_rate_hz
    asked = segments(seed, tuple(s.name for s in direct.signals), rate_hz)
    expected = [direct.play(segment).channels for segment in asked]
    with TemporaryDirectory(prefix="mccd-soak-") as folder:
        journal = Path(folder) / "journal"
        with emulator(seed, transport, str(seed), journal) as address:
            started_s = time.monotonic()
            result, message, retries = _played(address, asked, expected, watchdog_s)
            seconds = time.monotonic() - started_s
            safe = _becomes_safe(journal, watchdog_s)
        struck = journal.read_text().splitlines()[-1].partition("faults: ")[2]
    broken = {"wrong data": result, "bug": result}.get(result, "")
    if result == "error" and not struck:
        broken = "an error without a fault"
    broken = broken or ("" if seconds <= BOUND_S else "late") or ("" if safe else "not safe")
    return Outcome(seed, transport, faults, struck, result, message, retries, round(seconds, 2), broken)


def _played(
    address: str, asked: list[Segment], expected: list[dict[str, np.ndarray]], watchdog_s: float
) -> tuple[str, str, int]:
    kind, _, rest = address.partition(":")
    bench = None
    try:
        transport = transport_at(kind, f"{rest}@{PTY_BAUD}" if kind == "serial" else rest)
        bench = SerialBench(transport, kind, watchdog_s=watchdog_s)
        for segment, right in zip(asked, expected, strict=True):
            got = bench.play(segment).channels
            if list(got) != list(right) or any(got[n].tobytes() != right[n].tobytes() for n in right):
                return "wrong data", segment.label, bench.retries
        return "right data", "", bench.retries
    except (HardwareError, ConfigError) as error:
        # what was asked is within every limit, so only a HardwareError is a clear answer
        message = " ".join(str(error).replace(rest, "BENCH").split())
        return ("error" if isinstance(error, HardwareError) else "bug"), message, bench.retries if bench else 0
    except Exception as error:
        return "bug", f"{type(error).__name__}: {error}", bench.retries if bench else 0
    finally:
        if bench is not None:
            bench.close()


def _becomes_safe(journal: Path, watchdog_s: float) -> bool:
    """Whether the bench's own journal tells of a safe state by the time that its watchdog must have acted."""
    end_s = time.monotonic() + watchdog_s + STALL_S
    while True:
        states = [line.split()[2] for line in journal.read_text().splitlines()]
        if [state for state in states if state != "refused"][-1] in ("idle", "fault"):
            return True
        if time.monotonic() > end_s:
            return False
        time.sleep(0.02)


def summary(code: str, outcomes: list[Outcome]) -> dict[str, object]:
    """Count what happened."""
    struck: Counter[str] = Counter()
    for outcome in outcomes:
        for word in filter(None, outcome.struck.split(", ")):
            kind, count = word.split()
            struck[kind] += int(count)
    return {
        "mccd": code,
        "machine": f"Python {platform.python_version()}, {platform.system()} {platform.machine()}",
        "command": " ".join(["python -m benchmarks.soak_serial", *sys.argv[1:]]),
        "seeds": len(outcomes),
        "results": dict(Counter(outcome.result for outcome in outcomes)),
        "broken": [asdict(outcome) for outcome in outcomes if outcome.broken],
        "faults_struck": dict(struck),
        "retries": sum(outcome.retries for outcome in outcomes),
        "longest_s": max(outcome.seconds for outcome in outcomes),
        "bound_s": BOUND_S,
    }


def main() -> int:
    """Run the soak and write its result."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--workers", type=int, default=4)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args()
    code = f"{tool_version()} (commit {tool_commit()})"
    run_seed(0)  # compiles, before workers are forked
    outcomes: list[Outcome] = []
    with multiprocessing.get_context("fork").Pool(options.workers) as pool:
        wanted = range(options.first, options.first + options.seeds)
        for outcome in pool.imap_unordered(run_seed, wanted):
            outcomes.append(outcome)
            if outcome.broken or len(outcomes) % 50 == 0:
                print(f"{len(outcomes)} of {options.seeds}: {outcome}", file=sys.stderr, flush=True)
    outcomes.sort(key=lambda outcome: outcome.seed)
    counted = summary(code, outcomes)
    options.out.mkdir(parents=True, exist_ok=True)
    stem = options.out / f"serial-soak-{datetime.now(UTC):%Y-%m-%d}"
    stem.with_suffix(".json").write_text(json.dumps(counted, indent=2) + "\n", encoding="utf-8")
    with stem.with_suffix(".csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.DictWriter(file, list(asdict(outcomes[0])), lineterminator="\n")
        rows.writeheader()
        rows.writerows(asdict(outcome) for outcome in outcomes)
    print(json.dumps(counted, indent=2))
    return 1 if counted["broken"] else 0


if __name__ == "__main__":
    sys.exit(main())
