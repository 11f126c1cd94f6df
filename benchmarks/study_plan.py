"""Plan a million trials on paper, from what `benchmarks.study_cost` has measured: one formula per row.

    python -m benchmarks.study_plan benchmarks/results/study-cost-2026-11-21.json

`benchmarks/results/study-plan-*.md` holds what this prints; `tests/benchmarks/test_study_plan.py` compares the two.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from analysis.study.engines import AHEAD

TRIALS = 1_000_000
MEASURED = 4
"""Workers of the one machine that was measured."""

EXTRAPOLATED = (10, 64)
"""Workers of clusters that were not."""

MARK = "*"
"""What stands behind an extrapolated number."""


@dataclass(frozen=True)
class Cost:
    """What the plan takes from a result for one study: every number is a key of that file."""

    alone_per_s: float
    machine_per_s: float
    dispatch_per_s: float
    worker_mb: float
    scheduler_mb: float
    study_mb: float
    keep_ms: float
    conclude_s: float
    trial_bytes: float

    @classmethod
    def of(cls, result: Mapping[str, Any], study: str) -> Cost:
        """Return the numbers of one study, `spread` or `power`."""
        threads = _row(result["threads"], study=study, workers=1)
        cluster = _row(result["cluster"], study=study, workers=MEASURED)
        # files of before trials that do nothing ran in threads too say no engine
        idle = [row for row in result["trials_that_do_nothing"] if row.get("engine", "cluster") == "cluster"]
        keeping = result["book_keeping"]
        whole = _row(keeping, trials=TRIALS)
        return cls(
            alone_per_s=threads["trials_per_s"],
            machine_per_s=cluster["trials_per_s"],
            dispatch_per_s=max(idle, key=lambda row: (row["workers"], row["trials"]))["trials_per_s"],
            worker_mb=cluster["worker_peak_mb"],
            scheduler_mb=cluster["scheduler_peak_mb"],
            study_mb=max(cluster["peak_mb"], whole["peak_mb"]),
            keep_ms=_row(keeping, finishing_at_once=1)["keep_ms_per_trial"],
            conclude_s=whole["conclude_s"],
            trial_bytes=whole["bytes_per_trial"]["trials.sqlite"] + whole["bytes_per_trial"]["trials.csv"],
        )

    def rate_per_s(self, workers: int) -> float:
        """Return how many trials finish: as measured on one machine, else what workers and dispatch allow."""
        return self.machine_per_s if workers == MEASURED else min(workers * self.alone_per_s, self.dispatch_per_s)


def _row(rows: list[dict[str, Any]], **wanted: object) -> dict[str, Any]:
    for row in rows:
        if all(row[name] == value for name, value in wanted.items()):
            return row
    raise SystemExit(f"the result has no row with {wanted}; measure all parts with `python -m benchmarks.study_cost`")


@dataclass(frozen=True)
class Line:
    """One row of the plan: `value` of a number of workers; `depends` on them unless it is the same for any."""

    what: str
    formula: str
    value: Callable[[Cost, int], str]
    depends: bool = True


def time_text(seconds: float) -> str:
    """Return a duration in the unit in which people say it, in two digits."""
    for size, unit in ((86_400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{_two_digits(seconds / size)} {unit}"
    return f"{_two_digits(seconds)} s"


def _two_digits(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"


LINES = (
    Line(
        "trials per s",
        "4 workers: `cluster.trials_per_s`; W workers: the lesser of W × `threads[1].trials_per_s` and "
        "`trials_that_do_nothing.trials_per_s`",
        lambda cost, w: _two_digits(cost.rate_per_s(w)),
    ),
    Line("wall time", "10⁶ / that", lambda cost, w: time_text(TRIALS / cost.rate_per_s(w))),
    Line(
        "keeping, if every trial ends alone",
        "10⁶ × `book_keeping[1 at once].keep_ms_per_trial`, beside the trials",
        lambda cost, w: time_text(1e-3 * TRIALS * cost.keep_ms),
        depends=False,
    ),
    Line(
        "summary and files",
        "`book_keeping[10⁶].conclude_s`",
        lambda cost, w: time_text(cost.conclude_s),
        depends=False,
    ),
    Line(
        "memory of the workers",
        "W × `cluster.worker_peak_mb`",
        lambda cost, w: f"{_two_digits(w * cost.worker_mb / 1e3)} GB",
    ),
    Line(
        "memory of scheduler and study",
        "`cluster.scheduler_peak_mb` + the larger of `cluster.peak_mb` and `book_keeping[10⁶].peak_mb`",
        lambda cost, w: f"{_two_digits((cost.scheduler_mb + cost.study_mb) / 1e3)} GB",
        depends=False,
    ),
    Line(
        "disk",
        "10⁶ × `book_keeping[10⁶].bytes_per_trial` of trials.sqlite and trials.csv",
        lambda cost, w: f"{_two_digits(1e-9 * TRIALS * cost.trial_bytes)} GB",
        depends=False,
    ),
    Line(
        "work lost by a kill of the study",
        f"at most {AHEAD} × W / `threads[1].trials_per_s`",
        lambda cost, w: time_text(AHEAD * w / cost.alone_per_s),
    ),
)


def table(result: Mapping[str, Any], study: str) -> str:
    """Return the plan for one study as a table in Markdown; what was not measured with so many workers is marked."""
    cost = Cost.of(result, study)
    workers = (MEASURED, *EXTRAPOLATED)
    heads = ["", "from", f"this machine, {MEASURED} workers", *(f"{w} workers{MARK}" for w in EXTRAPOLATED)]
    rows = [heads, ["---"] * len(heads)]
    for line in LINES:
        cells = [line.value(cost, w) + (MARK if line.depends and w != MEASURED else "") for w in workers]
        rows.append([line.what, line.formula, *cells])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def main(arguments: list[str] | None = None) -> int:
    """Print the tables of both studies."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("result", type=Path)
    result = json.loads(parser.parse_args(arguments).result.read_text(encoding="utf-8"))
    print("\n\n".join(f"{study}\n\n{table(result, study)}" for study in ("spread", "power")))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
