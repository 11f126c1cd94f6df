"""One diagnosis of a full campaign with a hidden effect: three logs, the whole library, page and figures, two cores."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.speed.base import Agreement, Benchmark, Contender, Prepared, at_most_seconds
from benchmarks.speed.commands import CORES, Commands

OURS = "mccd diagnose"
FAMILY = "coulomb-friction"
VERDICTS = ("consistent", "named", "ambiguous", "unknown")


def prepare(quick: bool, folder: Path) -> Prepared:
    """Return the diagnosis of a blind case, made by `mccd challenge make` from a fixed seed."""
    commands = Commands(folder)
    shape = "short" if quick else "full"
    commands.mccd(
        *("challenge", "make", "blind", "--family", FAMILY, "--shape", shape, "--none", "0", "--seed", "4"),
    )
    (case,) = (folder / "blind" / "cases").iterdir()
    logs = [str(path) for path in sorted(case.glob("*.h5"))]

    def diagnose() -> Any:
        given = ["--model", str(case / "nominal.toml"), "-o", str(folder / "out")]
        ran = commands.mccd("diagnose", *logs, *given, "--json", may_fail=True)
        return json.loads(ran.out)

    return Prepared(
        (Contender(OURS, diagnose, rounds=3, warm=0 if quick else 1),),
        check,
        {},
        {"logs": len(logs), "MB": sum(Path(log).stat().st_size for log in logs) / 1e6, "cores": CORES},
    )


def check(results: Mapping[str, Any]) -> list[Agreement]:
    """Ask for a verdict alone: whether it is right is what a challenge scores."""
    lacking = float(results[OURS]["verdict"] not in VERDICTS)
    return [Agreement(OURS, lacking, 0.0, "ends in a verdict")]


BENCHMARK = Benchmark(
    "diagnosis",
    f"`mccd diagnose` of a blind campaign that hides {FAMILY}, its page and figures written",
    prepare,
    (at_most_seconds(OURS, 60.0),),
    {},
)
