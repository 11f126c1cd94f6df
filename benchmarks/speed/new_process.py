"""The first 60 simulated seconds of the full bench in a new process: what a user sees, who never warms anything up."""

from __future__ import annotations

import json
from collections.abc import Mapping
from itertools import count
from pathlib import Path
from typing import Any

from benchmarks.speed.base import Agreement, Benchmark, Contender, Prepared, Round, Target
from benchmarks.speed.chopping import QUICK, RATE_HZ, SAMPLES
from benchmarks.speed.commands import Commands

KEPT, EMPTY = "mccd, a new process, kernels kept", "mccd, a new process, no kernel kept"

PLAY = """
import hashlib, json, sys, time
from benchmarks.speed.chopping import SEED, chopping
from sim_backend.model import load_model
from sim_backend.simbench import SimBench
segment, bench = chopping(int(sys.argv[1])), SimBench(load_model("as-built"), SEED)
assert "llvmlite" not in sys.modules and "numba" not in sys.modules
started_s = time.perf_counter()
played = bench.play(segment).channels
took_s = time.perf_counter() - started_s
digest = hashlib.sha256(b"".join(played[name].tobytes() for name in sorted(played))).hexdigest()
print(json.dumps({"seconds": took_s, "digest": digest}))
"""
"""What is timed begins when the bench is there and ends when the record is: compiling and loading
of kernels, and of LLVM, too."""


def prepare(quick: bool, folder: Path) -> Prepared:
    """Return both; the kernels of the first are those that earlier processes of this benchmark have left."""
    samples, numbers = QUICK if quick else SAMPLES, count()

    def play(kernels: str) -> dict[str, Any]:
        ran = Commands(folder, {"MCCD_KERNEL_CACHE": str(folder / kernels)}).python("-c", PLAY, str(samples))
        if ran.code:
            raise RuntimeError(f"playing in a new process ended with {ran.code}")
        return {**json.loads(ran.out), "samples": samples}

    return Prepared(
        (
            Contender(KEPT, lambda: play("kept"), samples, warm=1),
            Contender(EMPTY, lambda: play(f"empty-{next(numbers)}"), samples, rounds=3, warm=0),
        ),
        check,
        {},
        {"samples": samples},
    )


def check(results: Mapping[str, Any]) -> list[Agreement]:
    """Compare all channels, bit for bit."""
    same = results[EMPTY]["digest"] == results[KEPT]["digest"]
    return [Agreement(EMPTY, float(not same), 0.0, "every channel is the same, bit for bit")]


def real_time(turn: Round) -> float:
    """Return simulated seconds per second, with kernels kept."""
    found = turn.results[KEPT]
    return float(found["samples"] / RATE_HZ / found["seconds"])


def compiling_s(turn: Round) -> float:
    """Return by how many seconds longer it takes where nothing is kept."""
    return float(turn.results[EMPTY]["seconds"] - turn.results[KEPT]["seconds"])


BENCHMARK = Benchmark(
    name="new-process",
    work="60 simulated seconds of the bench as built, the first ones of a process, all channels kept in memory",
    prepare=prepare,
    targets=(
        Target(f"{KEPT}: times real time", 500.0, "×", (KEPT,), real_time),
        Target(f"{EMPTY}: seconds longer", 5.0, "s", (KEPT, EMPTY), compiling_s, at_most=True),
    ),
    missed={
        f"{KEPT}: times real time": "of 0.12 s that it may take, the loop takes 0.05 s, noise 0.013 s and what "
        "the process has to load 0.003 s; the rest is first use of 77 MB, 0.01 s, but up to 0.2 s where a virtual "
        "machine hands out memory that it has never held",
    },
)
