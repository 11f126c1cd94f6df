"""What the page says first: which requirements are met, by whom, how many predictions agree, and every miss."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from analysis.paper.causes import NOT_EXPLAINED, cause_of
from analysis.paper.rows import Count, Row, Table, label_counts
from campaigns.benches import DEFAULT_MODEL
from campaigns.log import Run
from sim_backend.bench import SIMULATED


@dataclass(frozen=True)
class Misses:
    """Rows of one table that do not agree for one reason."""

    rows: tuple[Row, ...]
    cause: str


@dataclass(frozen=True)
class Verdict:
    """Requirements met of those measured, by the paper's controllers here, this project's and the paper's own numbers.

    `missed` and `own_missed` name those that are not met; `unlike` are rows met here but not by the paper's numbers, or
    the other way round; `worse` those in which this project's controller is behind the paper's. `predicted` counts the
    predictions. `misses` has every row that does not agree, by table. `folded` and `repeated` are not counted.
    """

    met: int
    measured: int
    missed: tuple[str, ...]
    paper_met: int
    unlike: tuple[Row, ...]
    predicted: Count
    misses: dict[str, tuple[Misses, ...]]
    own_met: int = 0
    own_measured: int = 0
    own_missed: tuple[str, ...] = ()
    worse: tuple[Row, ...] = ()
    folded: dict[str, Table] = field(default_factory=dict)
    repeated: tuple[Row, ...] = ()


def verdict_of(tables: dict[str, Table], runs: Sequence[Run] = ()) -> Verdict:
    """Return the verdict over all tables; the requirements are those of Table 6.6.

    Causes are known for the bundled bench: without its `runs`, misses of it are not explained.
    """
    of_bench = tables["6.6"].rows if "6.6" in tables else ()
    required = [row for row in of_bench if row.met is not None]
    own = [row for row in of_bench if row.own_met is not None]
    bundled = bool(runs) and all(_bundled(run) for run in runs)
    return Verdict(
        met=sum(bool(row.met) for row in required),
        measured=len(required),
        missed=tuple(row.number.row for row in required if not row.met),
        paper_met=sum(bool(row.paper_met) for row in required),
        unlike=tuple(row for row in required if row.paper_met is not None and row.paper_met != row.met),
        predicted=label_counts(list(tables.values()))["predicted"],
        misses={
            key: found
            for key, table in tables.items()
            # what rests on no run was computed from design models
            if (found := _misses(table, bundled or not table.run_uids))
        },
        own_met=sum(bool(row.own_met) for row in own),
        own_measured=len(own),
        own_missed=tuple(row.number.row for row in own if not row.own_met),
        worse=tuple(row for row in own if row.own_worse),
        folded={key: table for key, table in tables.items() if table.paper.folded},
        repeated=tuple(row for table in tables.values() for row in table.rows if row.number.repeats),
    )


def simulated(run: Run) -> bool:
    """Tell whether a run was played on a simulated bench."""
    return run.header.bench.get("kind") in SIMULATED


def _bundled(run: Run) -> bool:
    return simulated(run) and run.header.bench.get("name") == DEFAULT_MODEL


def _misses(table: Table, explained: bool) -> tuple[Misses, ...]:
    """Return the misses of a table, those of one cause together, in the order of the table."""
    causes: dict[str, list[Row]] = {}
    for row in table.rows:
        if row.missed:
            causes.setdefault(_cause(table.key, row) if explained else NOT_EXPLAINED, []).append(row)
    return tuple(Misses(tuple(rows), cause) for cause, rows in causes.items())


def _cause(key: str, row: Row) -> str:
    if row.noisy:
        return "the noise decides"
    return cause_of(key, row.number.key) if row.determined else "ours is more uncertain than it is large"
