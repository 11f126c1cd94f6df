"""Whole commands on large logs, and the most memory that each holds: every form of export, diagnosis, identification.

The exports read a log with every channel of the bench; diagnosis and identification one of a single axis with a
hardening spring, played as realisations of a multisine.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from scipy.io import loadmat

from benchmarks.speed.base import Agreement, Benchmark, Contender, Prepared
from benchmarks.speed.commands import CORES, Commands, Ran, at_most_mb
from benchmarks.speed.long_log import chopped, contents, write
from benchmarks.speed.one_diagnosis import VERDICTS
from campaigns.log import read_run
from campaigns.plans import make_plan
from campaigns.playing.runner import run_plan
from sim_backend.model import EffectEntry, load_model
from sim_backend.simbench import SimBench

FORMS = ("csv", "npz", "mat")
EXPORTS = {form: f"mccd log export (.{form})" for form in FORMS}
DIAGNOSE, IDENTIFY = "mccd diagnose, one axis", "mccd identify, one axis"
LIMIT_MB = 500.0
BYTES, QUICK = 500_000_000, 50_000_000
REALISATIONS, QUICK_REALISATIONS = 500, 3
"""Of ten seconds each, a tenth of it in the quick run."""
CHANNEL = "theta_x"
EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
BENCH, NOMINAL = EXAMPLES / "quiet.toml", EXAMPLES / "nominal.toml"
HIDDEN = EffectEntry(effect="cubic-stiffness", where=CHANNEL, parameters={"stiffness": 100.0})
MODE_HZ = 29.6
"""The mode of the bench."""


def play(path: Path, realisations: int, periods: int) -> int:
    """Write the log of one axis and return its rows."""
    model = load_model(BENCH)
    bench = SimBench(msgspec.structs.replace(model, effects=[*model.effects, HIDDEN]), 0)
    axis = {"axes": (CHANNEL,), "torque_rms_nm": 0.01, "stop_hz": 200.0, "period_s": 0.5}
    plan = make_plan("multisine", axis | {"realisations": realisations, "periods": periods})
    run_plan(plan, bench, path, seed=0)
    with read_run(path) as run:
        return run.rows


def ends(path: Path) -> list[float]:
    """Return the first and the last reading of an export."""
    if path.suffix == ".npz":
        with np.load(path) as file:
            values = file[CHANNEL]
    elif path.suffix == ".mat":
        values = loadmat(path, squeeze_me=True)["run"]["channels"].item()[CHANNEL].item()
    else:
        with path.open("rb") as file:
            head, first = file.readline().decode().split(","), file.readline()
            file.seek(-4096, 2)
            last = file.read().splitlines()[-1]
        at = next(i for i, name in enumerate(head) if name.startswith(f"{CHANNEL} "))
        values = [float(line.split(b",")[at]) for line in (first, last)]
    return [float(values[0]), float(values[-1])]


def prepare(quick: bool, folder: Path) -> Prepared:
    """Return the commands; each reads its log once, in a process of its own."""
    commands, wide, narrow = Commands(folder), folder / "wide.h5", folder / "narrow.h5"
    channels, chop, settings = chopped()
    segments = list(contents(chop, settings, (QUICK if quick else BYTES) // 8 // len(channels)))
    rows = write(wide, channels, segments)
    known = [float(segments[0][2][CHANNEL][0]), float(segments[-1][2][CHANNEL][-1])]
    long = play(narrow, *((QUICK_REALISATIONS, 2) if quick else (REALISATIONS, 20)))

    def exported(form: str) -> tuple[Ran, list[float]]:
        out = folder / f"wide.{form}"
        ran = commands.mccd("log", "export", str(wide), "-o", str(out))
        found = ends(out)
        out.unlink()
        return ran, found

    diagnosis = ("diagnose", str(narrow), "--model", str(NOMINAL), "-o", str(folder / "diagnosis"), "--json")
    fitted = folder / "fitted.toml"
    identification = ("identify", "--log", str(narrow), "-o", str(fitted), "--json")

    def identified() -> Ran:
        fitted.unlink(missing_ok=True)
        return commands.mccd(*identification)

    def contender(name: str, run: Callable[[], Any], *arguments: str, warm: int = 0) -> Contender:
        def memory() -> list[str]:
            for left in (fitted, *folder.glob("wide.[cnm]*")):
                left.unlink(missing_ok=True)
            return commands.sampled(*arguments, may_fail=True).by_memory()

        return Contender(name, run, rounds=1, warm=warm, profile=memory)

    contenders = [
        contender(name, partial(exported, form), "log", "export", str(wide), "-o", str(folder / f"wide.{form}"))
        for form, name in EXPORTS.items()
    ]
    contenders.append(contender(DIAGNOSE, partial(commands.mccd, *diagnosis, may_fail=True), *diagnosis))
    # the first identification ever compiles its loops, which takes memory of its own: `long-log` tells how much
    contenders.append(contender(IDENTIFY, identified, *identification, warm=0 if quick else 1))
    facts = {"cores": CORES, "MB of the wide log": wide.stat().st_size / 1e6, "its rows": rows}
    facts |= {"MB of the log of one axis": narrow.stat().st_size / 1e6, "rows of that": long}
    return Prepared(tuple(contenders), partial(check, known), {}, facts)


def check(known: list[float], results: Mapping[str, Any]) -> list[Agreement]:
    """Compare the ends of every export with what was written, the mode with the bench's; a verdict is asked for."""
    found = [
        Agreement(name, float(np.max(np.abs(np.subtract(results[name][1], known)))), 0.0, "first and last row")
        for name in EXPORTS.values()
    ]
    lacking = float(json.loads(results[DIAGNOSE].out)["verdict"] not in VERDICTS)
    modes = [mode["frequency_hz"] for mode in json.loads(results[IDENTIFY].out)["identification"]["modes"]]
    missed = float(np.min(np.abs(np.array(modes) / MODE_HZ - 1.0)))
    # the spring adds 3 k <x^2> to the mode's 11 N m/rad: 0.3 % at 10 mrad rms, ten times what the torque makes at rest
    return [
        *found,
        Agreement(DIAGNOSE, lacking, 0.0, "ends in a verdict"),
        Agreement(IDENTIFY, missed, 1e-2, "relative, of the mode: the hidden spring stiffens it"),
    ]


def peak(result: Any) -> Ran:
    """Return the command behind a result."""
    return result[0] if isinstance(result, tuple) else result


BENCHMARK = Benchmark(
    "log-commands",
    "exports of a log with every channel of the bench, diagnosis and identification of one with a single axis",
    prepare,
    tuple(at_most_mb(name, LIMIT_MB, of=peak) for name in (*EXPORTS.values(), DIAGNOSE, IDENTIFY)),
    {
        f"{DIAGNOSE}: peak memory": (
            "A diagnosis weighs every candidate of the library by what it would leave in the readings: columns as long "
            "as the rows that are used, 250,000 unless told otherwise, once as they are and once whitened. They are "
            "multiplied with each other, so that all have to be there at a time; memory falls with `--rows`."
        ),
    },
)
