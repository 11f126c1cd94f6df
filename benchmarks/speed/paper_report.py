"""The whole campaign of the paper with its report, designed controller included, on two cores: warm, and the first."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import count
from pathlib import Path
from typing import Any

from benchmarks.speed.base import Agreement, Benchmark, Contender, Prepared, at_most_seconds
from benchmarks.speed.commands import CORES, Commands

WARM, COLD = "mccd report", "mccd report, the first ever"
QUICK = """
schema = "mccd-campaign/1"
name = "one run"
[[runs]]
name = "endstops"
plan = "endstops"
settings = { ramp_s = 0.1, settle_s = 0.1, hold_s = 0.1 }
"""


def prepare(quick: bool, folder: Path) -> Prepared:
    """Return both; the first ever finds no compiled module of any package, no compiled loop and no list of fonts."""
    numbers = count()
    (folder / "quick.toml").write_text(QUICK, encoding="utf-8")
    given = ["--campaign", str(folder / "quick.toml")] if quick else []

    def report(commands: Commands) -> str:
        out = folder / f"report-{next(numbers)}"
        commands.mccd("report", *given, "--out", str(out))
        return (out / "report.json").read_text(encoding="utf-8")

    def cold() -> str:
        empty = folder / f"empty-{next(numbers)}"
        caches = {"MCCD_KERNEL_CACHE": "kernels", "MPLCONFIGDIR": "fonts"}
        caches |= {} if quick else {"PYTHONPYCACHEPREFIX": "modules"}
        return report(Commands(folder, {name: str(empty / place) for name, place in caches.items()}))

    return Prepared(
        (
            Contender(WARM, lambda: report(Commands(folder)), rounds=3, warm=0 if quick else 1),
            Contender(COLD, cold, rounds=1, warm=0),
        ),
        check,
        {},
        {"cores": CORES},
    )


def check(results: Mapping[str, Any]) -> list[Agreement]:
    """Compare all numbers of the report."""
    return [Agreement(COLD, float(results[COLD] != results[WARM]), 0.0, "report.json is the same, digit for digit")]


BENCHMARK = Benchmark(
    "paper",
    "`mccd report` into an empty folder: the 30 runs of the paper, a controller designed from them, its 18 runs, "
    "all tables and figures",
    prepare,
    (at_most_seconds(WARM, 30.0), at_most_seconds(COLD, 60.0)),
    {},
)
