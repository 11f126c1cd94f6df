"""How many benches meet every requirement: benches drawn about the one as built, each with the same controllers.

    python -m benchmarks.robustness --controller design/controller.toml --benches 1000
    python -m benchmarks.robustness --controller design/controller.toml --benches 20 --far --frequency 3%
    python -m benchmarks.robustness --own-logs --far --benches 100

The controller was designed once, on logs of the bench as built; with --own-logs one is designed for each bench, on its
own logs. Every drawn bench has other modes, damping, gains, hysteresis, noise and temperature; the paper's strategies
are played on the same benches with the same noise. Each bench is one line of a file, so that a run that was stopped
goes on where it was. A run is safe unless an axis strays after its step, or the coils dissipate too much, for more than
three cycles in a row. Exit code 1 unless every bench was safe and, up to 1 % in frequency, enough met everything.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import platform
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.robustness_benches import COLD_K, FAR_COLD_K, FAR_FREQUENCY, WARM_K, Spread, drawn_bench, far_bench
from benchmarks.robustness_own_logs import OWN, identified_and_played
from benchmarks.robustness_trial import (
    CYCLES,
    LIMITS,
    SLOW_ALPHA_DEG,
    SLOW_CYCLES,
    Judge,
    is_kept_safe,
    judge_of,
    misses,
    reason,
    verdict,
)
from campaigns.strategies.controller import load_controller
from campaigns.version import tool_commit, tool_version
from sim_backend.model import Model, load_model

OURS = "this project"
GOAL, GOAL_OWN_LOGS = 0.99, 0.95
"""Part of the benches that must meet everything: with one controller, and with one for each from its own logs."""

Row = dict[str, Any]


@dataclass(frozen=True)
class Draw:
    """Which benches are drawn: within `spread`, or far with modes up to a part `frequency` off where that is None."""

    seed: int
    spread: Spread | None
    frequency: float = FAR_FREQUENCY

    def bench(self, index: int) -> tuple[Model, dict[str, float]]:
        """Return a bench and what was drawn of it."""
        rng, model = np.random.default_rng([self.seed, index]), load_model("as-built")
        if self.spread is None:
            return far_bench(model, rng, self.frequency)
        return drawn_bench(model, self.spread, rng)

    def settings(self) -> dict[str, Any]:
        """Return what decides the benches as plain values."""
        drawn = {"far": self.frequency} if self.spread is None else asdict(self.spread)
        return {"seed": self.seed, "spread": drawn}


def strategies(controller: str) -> dict[str, Judge]:
    """Return what is judged: this project's controller, and the paper's strategies as its Table 6.6 uses them."""
    return {
        OURS: judge_of("designed", "designed", controller=controller),
        "paper, hybrid": judge_of("hybrid", "hybrid"),
        "paper, hybrid and repetitive": judge_of("repetitive", "hybrid"),
    }


def trial(index: int, draw: Draw, controller: str) -> Row:
    """Return one bench's results under every strategy; one that is stopped or cannot be played meets nothing."""
    bench, drawn = draw.bench(index)
    judged = {name: verdict(judge, bench, 2 * index) for name, judge in strategies(controller).items()}
    return {"index": index, **drawn, **judged}


def summary(rows: list[Row], names: list[str]) -> dict[str, Any]:
    """Return for every strategy how many benches met everything and stayed safe, and why the others did not."""
    out: dict[str, Any] = {}
    for name in names:
        found = [row[name] for row in rows]
        all_missed = [misses(one) for one in found]
        met, n = sum(not m for m in all_missed), len(rows)
        values = {k: [v for one in found if (v := one.get(k)) is not None] for k in (*LIMITS, "inside")}
        out[name] = {
            "met": met,
            "of": n,
            "fraction": met / n,
            "ci95": wilson(met, n),
            "safe": sum(map(is_kept_safe, found)),
            "reasons": dict(Counter(why for one in found if (why := reason(one))).most_common()),
            "missed": {k: sum(k in m for m in all_missed) for k in LIMITS},
            "median": {k: float(np.median(v)) for k, v in values.items() if v},
            "worst": {k: float(np.max(v) if k != "inside" else np.min(v)) for k, v in values.items() if v},
        }
    return out


def exit_code(found: dict[str, Any], goal: float | None) -> int:
    """Return 1 unless every bench was safe and a part `goal` of them met everything, None for no such goal."""
    return 0 if found["safe"] == found["of"] and (goal is None or found["fraction"] >= goal) else 1


def wilson(met: int, n: int) -> tuple[float, float]:
    """Return the 95 % interval of a fraction (Wilson, 1927)."""
    z = 1.959964
    p = met / n
    centre = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return float(centre - half), float(centre + half)


def resumed(lines: Path, count: int, settings: dict[str, Any], play: Callable[[int], Row]) -> list[Row]:
    """Return `count` rows, those of a file first; each of the others is played and added to it.

    The file begins with the settings that its rows were played with; raises SystemExit where they are others now.
    """
    text = lines.read_text().splitlines() if lines.exists() else []
    if text and json.loads(text[0]) != settings:
        raise SystemExit(f"{lines} holds trials of {text[0]}; move it away, or give another --out")
    rows, started = [json.loads(one) for one in text[1:]][:count], time.monotonic()
    with lines.open("a") as file:
        if not text:
            print(json.dumps(settings), file=file, flush=True)
        for index in range(len(rows), count):
            rows.append(play(index))
            print(json.dumps(rows[-1]), file=file, flush=True)
            print(f"{index + 1} of {count}, {time.monotonic() - started:.0f} s", file=sys.stderr)
    return rows


def percent(text: str) -> float:
    """Return a part from text such as 3% or 0.03."""
    value = float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
    if not 0.0 < value < 0.5:
        raise ValueError
    return value


def parsed(arguments: list[str] | None) -> argparse.Namespace:
    """Return the arguments; exits with what is wrong with them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--controller", help="the one that is played on all benches")
    parser.add_argument("--own-logs", action="store_true", help="identify and design on each bench's own logs instead")
    parser.add_argument("--benches", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scale", type=float, help="this many times the spread")
    parser.add_argument("--far", action="store_true", help="benches as far as a design must survive instead")
    parser.add_argument(
        "--frequency", type=percent, help="with --far: modes are up to this far off, 3%% or 0.03 (default 1%%)"
    )
    parser.add_argument("--out", type=Path, default=None, help="summary; its lines stand beside it as .jsonl")
    given = parser.parse_args(arguments)
    if bool(given.controller) == given.own_logs:
        parser.error("give --controller FILE, or --own-logs for one of each bench")
    if given.far and given.scale is not None:
        parser.error("--scale is that of the close benches; with --far give --frequency")
    if given.frequency is not None and not given.far:
        parser.error("--frequency is that of far benches; give --far with it, or --scale instead")
    return given


def main(arguments: list[str] | None = None) -> int:
    """Play what is missing of the trials, and write the summary."""
    given = parsed(arguments)
    draw = Draw(given.seed, None if given.far else Spread().times(given.scale or 1.0), given.frequency or FAR_FREQUENCY)
    settings, now = draw.settings(), datetime.now(UTC)
    kind = "own-logs" if given.own_logs else "robustness"
    out: Path = given.out or Path(__file__).parent / "results" / f"{kind}-{now:%Y-%m-%d}.json"
    lines = out.with_suffix(".jsonl")
    if given.own_logs:
        names, goal = [OWN], GOAL_OWN_LOGS
        rows = resumed(
            lines, given.benches, settings, lambda i: {"index": i, **identified_and_played(*draw.bench(i), i)}
        )
    else:
        load_controller(given.controller)  # one that is none would cost every trial
        settings["controller_sha256"] = hashlib.sha256(Path(given.controller).read_bytes()).hexdigest()
        names, goal = list(strategies("")), GOAL
        rows = resumed(lines, given.benches, settings, lambda i: trial(i, draw, given.controller))
    result = {
        "date_utc": f"{now:%Y-%m-%d}",
        "mccd": f"{tool_version()} ({tool_commit()})",
        "python": platform.python_version(),
        **settings,
        "thermal_range_k": [FAR_COLD_K if draw.spread is None else COLD_K, WARM_K],
        "trial": f"{SLOW_CYCLES} cycles at 0.5 Hz and {SLOW_ALPHA_DEG:g}°, {CYCLES} cycles at 5 Hz on each axis",
        "left_out": "the drift over five minutes, the other directions and forms, the lifetime",
        "limits": LIMITS,
        "strategies": summary(rows, names),
    }
    out.write_text(json.dumps(result, indent=2) + "\n")
    ours = result["strategies"][names[0]]
    print(json.dumps({key: ours[key] for key in ("met", "safe", "of", "reasons")}))
    return exit_code(ours, goal if draw.frequency <= FAR_FREQUENCY else None)


if __name__ == "__main__":
    raise SystemExit(main())
