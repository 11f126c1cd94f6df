"""`mccd --help` against a Python that does nothing: what is waited for before anything is asked."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.speed.base import Agreement, Benchmark, Contender, Prepared, Target
from benchmarks.speed.commands import Commands
from mccdcli.registry import COMMANDS

OURS, BARE = "mccd --help", "python -c pass"


def prepare(quick: bool, folder: Path) -> Prepared:
    """Return both; each is a process of its own."""
    commands = Commands(folder)
    return Prepared(
        (
            Contender(OURS, lambda: commands.mccd("--help").out),
            Contender(BARE, lambda: commands.python("-c", "pass").out),
        ),
        check,
        {},
        {},
    )


def check(results: Mapping[str, Any]) -> list[Agreement]:
    """Count the commands that the text does not name."""
    absent = sum(name.split()[0] not in results[OURS] for name in COMMANDS)
    return [Agreement(OURS, float(absent), 0.0, "commands that the text lacks")]


BENCHMARK = Benchmark(
    "help",
    "`mccd --help` in a new process, its modules compiled",
    prepare,
    (
        Target(
            f"{OURS}: time above {BARE}",
            0.1,
            "s",
            (OURS, BARE),
            lambda turn: turn.seconds[OURS] - turn.seconds[BARE],
            at_most=True,
        ),
    ),
    {},
)
