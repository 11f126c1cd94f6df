"""Diagnoses of full campaigns: nothing hidden, one effect, two at once; with page and figures, on two cores."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.speed.base import Agreement, Benchmark, Contender, Prepared, Round, Target
from benchmarks.speed.commands import CORES, Commands, Ran, Sampled

PANEL = {
    "nothing hidden": ("--none", "1", "--one", "0", "--family", "coulomb-friction"),
    "one effect hidden": ("--none", "0", "--one", "1", "--family", "coulomb-friction"),
    "two effects hidden": (
        *("--none", "0", "--one", "0", "--two", "1"),
        *("--family", "cubic-stiffness", "--family", "coulomb-friction", "--family", "hysteresis"),
    ),
}
"""What `mccd challenge make` is asked for, by what the case hides."""
SEED = 4
CASES = {name: f"mccd diagnose, {name}" for name in PANEL}
WATCHED = f"{CASES['two effects hidden']}, sampled"
VERDICTS = ("consistent", "named", "ambiguous", "unknown")


def prepare(quick: bool, folder: Path) -> Prepared:
    """Return the diagnoses of blind cases, made by `mccd challenge make` from a fixed seed."""
    commands = Commands(folder)
    chosen = list(PANEL)[::2] if quick else list(PANEL)
    facts: dict[str, Any] = {"cores": CORES}
    given: dict[str, tuple[str, ...]] = {}
    for number, name in enumerate(chosen):
        blind = folder / f"blind-{number}"
        shape = ("--shape", "short" if quick else "full", "--seed", str(SEED))
        commands.mccd("challenge", "make", str(blind), *PANEL[name], *shape)
        (case,) = (blind / "cases").iterdir()
        logs = sorted(case.glob("*.h5"))
        facts[name] = f"{len(logs)} logs of {sum(log.stat().st_size for log in logs) / 1e6:.1f} MB"
        out = str(folder / f"out-{number}")
        given[name] = (*map(str, logs), "--model", str(case / "nominal.toml"), "-o", out, "--json")

    def diagnosis(name: str, run: Callable[..., Ran]) -> Ran:
        return run("diagnose", *given[name], may_fail=True)

    def by_time(name: str) -> list[str]:
        return commands.sampled("diagnose", *given[name], may_fail=True).by_time()

    warm = 0 if quick else 1
    contenders = [
        Contender(
            CASES[name],
            partial(diagnosis, name, commands.mccd),
            rounds=3,
            warm=warm,
            profile=partial(by_time, name),
        )
        for name in chosen
    ]
    watched = partial(diagnosis, chosen[-1], commands.sampled)
    contenders.append(Contender(WATCHED, watched, rounds=1, warm=0))
    absent = {CASES[name]: "too slow for a quick look" for name in PANEL if name not in chosen}
    return Prepared(tuple(contenders), check, absent, facts, lambda results: {WATCHED: results[WATCHED].by_time()})


def check(results: Mapping[str, Any]) -> list[Agreement]:
    """Ask for a verdict, and the same from the run that was watched: whether it is right is what a challenge scores."""
    verdicts = {name: json.loads(ran.out)["verdict"] for name, ran in results.items()}
    ended = {name: float(verdict not in VERDICTS) for name, verdict in verdicts.items()}
    differs = float(verdicts[WATCHED] != verdicts[CASES["two effects hidden"]])
    what = {name: "ends in a verdict" for name in verdicts} | {WATCHED: "ends in the same verdict"}
    return [Agreement(name, max(wrong, differs * (name == WATCHED)), 0.0, what[name]) for name, wrong in ended.items()]


def slowest(turn: Round) -> float:
    """Return the time of the slowest diagnosis, in seconds."""
    return max(turn.seconds[name] for name in CASES.values())


def compiled(turn: Round) -> float:
    """Return the share of processor time in compiled code, in percent."""
    ran: Sampled = turn.results[WATCHED]
    return ran.compiled()


TWO_FIRST = tuple(reversed(CASES.values()))
BENCHMARK = Benchmark(
    "diagnosis",
    "`mccd diagnose` of blind campaigns that hide nothing, one effect and two, each with its page and figures written",
    prepare,
    (
        Target("mccd diagnose: time of the slowest", 60.0, "s", TWO_FIRST, slowest, at_most=True),
        Target("mccd diagnose: share of processor time in compiled code", 50.0, "%", (WATCHED,), compiled),
    ),
    {},
)
