"""What the trials of a study say together: quantiles of every number, shares of every flag with their interval."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.study.definition import Swept
from analysis.study.kinds import Column
from analysis.study.store import Store
from analysis.study.trial import Job

Array = NDArray[np.float64]

QUANTILES = {"q05": 0.05, "median": 0.5, "q95": 0.95}
LEVEL = 0.95


@dataclass(frozen=True)
class Share:
    """`hits` of `of` trials, their fraction, and its 95 % interval (Wilson, JASA 22, 1927)."""

    hits: int
    of: int
    fraction: float
    ci95: tuple[float, float]

    @classmethod
    def count(cls, hits: int, of: int) -> Share:
        """Return the share; nothing is known when there is nothing to count."""
        if of == 0:
            return cls(0, 0, float("nan"), (0.0, 1.0))
        interval = scipy.stats.binomtest(hits, of).proportion_ci(LEVEL, method="wilson")
        return cls(hits, of, hits / of, (float(interval.low), float(interval.high)))


@dataclass(frozen=True)
class Numbers:
    """One number over the trials that measured it: order statistics, and the share of trials that keep its limit.

    A trial that came to nothing keeps no limit, and so does a number that is infinite; one that a bench cannot measure
    is not counted.
    """

    n: int
    quantiles: Mapping[str, float]
    lowest: float
    highest: float
    limit: float | None
    within: Share | None


@dataclass(frozen=True)
class Point:
    """One point of the grid: how its trials ended, its numbers, flags and texts by column."""

    at: Mapping[str, Swept]
    done: int
    failed: int
    broken: int
    numbers: Mapping[str, Numbers]
    flags: Mapping[str, Share]
    texts: Mapping[str, Mapping[str, Share]]


@dataclass(frozen=True)
class Reason:
    """Why trials came to nothing: how many for the same reason, and the first of them."""

    status: str
    reason: str
    trials: int
    first: int


@dataclass(frozen=True)
class Summary:
    """A study as far as it has come."""

    name: str
    kind: str
    total: int
    finished: int
    failed: int
    broken: int
    points: tuple[Point, ...]
    reasons: tuple[Reason, ...]


def summarise(job: Job, store: Store) -> Summary:
    """Return what the finished trials say; it does not depend on how or in which order they were done."""
    total, n_points = job.study.total, len(job.study.points)
    statuses = np.array(store.statuses(total), dtype="U6").reshape(-1, n_points)
    measured = {c.name: _column(store, c, total).reshape(-1, n_points) for c in job.columns}
    points = tuple(
        _point(job, at, statuses[:, p], {name: values[:, p] for name, values in measured.items()})
        for p, at in enumerate(job.study.points)
    )
    return Summary(
        name=job.study.name,
        kind=job.study.kind,
        total=total,
        finished=int(np.count_nonzero(statuses != "")),
        failed=sum(p.failed for p in points),
        broken=sum(p.broken for p in points),
        points=points,
        reasons=tuple(Reason(*row) for row in store.reasons(total)),
    )


def _column(store: Store, column: Column, total: int) -> NDArray[np.generic]:
    if column.kind == "text":
        return np.array(store.texts(column.name, total), dtype=object)
    return store.numbers(column.name, total)


def _point(
    job: Job, at: Mapping[str, Swept], statuses: NDArray[np.str_], measured: Mapping[str, NDArray[np.generic]]
) -> Point:
    done = statuses == "done"
    counted = {name: int(np.count_nonzero(statuses == name)) for name in ("done", "failed", "broken")}
    numbers, flags, texts = {}, {}, {}
    for column in job.columns:
        values = measured[column.name][done]
        if column.kind == "number":
            lost = counted["failed"] + counted["broken"]
            numbers[column.name] = _numbers(np.asarray(values, dtype=float), column.limit, lost)
        elif column.kind == "flag":
            known = np.asarray(values, dtype=float)
            known = known[~np.isnan(known)]
            flags[column.name] = Share.count(int(known.sum()), known.size)
        else:
            seen = Counter(str(v) for v in values if v)
            texts[column.name] = {text: Share.count(seen[text], seen.total()) for text in sorted(seen)}
    return Point(at, **counted, numbers=numbers, flags=flags, texts=texts)


def _numbers(values: Array, limit: float | None, lost: int) -> Numbers:
    known = np.sort(values[~np.isnan(values)])
    nothing = float("nan")
    # order statistics: an infinite number (a move that never settles) has its place among them, a mean has none
    at = {name: max(int(np.ceil(q * known.size)) - 1, 0) for name, q in QUANTILES.items()}
    within = None if limit is None else Share.count(int(np.count_nonzero(known <= limit)), known.size + lost)
    return Numbers(
        n=int(known.size),
        quantiles={name: float(known[i]) if known.size else nothing for name, i in at.items()},
        lowest=float(known[0]) if known.size else nothing,
        highest=float(known[-1]) if known.size else nothing,
        limit=limit,
        within=within,
    )
