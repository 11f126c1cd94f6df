"""The score of a challenge: every measure with its interval beside what it must reach."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from campaigns.challenge.intervals import bootstrap_interval, half_points, share_interval
from campaigns.challenge.judge import Judged, judge
from campaigns.challenge.run import cases_of, was_run
from campaigns.challenge.truth import reveal
from sim_backend.errors import ConfigError

Array = NDArray[np.float64]

CHI2_MEDIAN = 0.4549364231195724
"""Median of the square of a standard normal number: what the median squared error over its variance should be."""


@dataclass(frozen=True)
class Measure:
    """One row of the score: value and interval over `n` items, and whether it is within `low` to `high`.

    `ok` is None when there was nothing to measure, or nothing that it must reach.
    """

    name: str
    value: float | None
    interval: tuple[float, float] | None
    n: int
    low: float | None
    high: float | None
    must: str

    @property
    def ok(self) -> bool | None:
        """Whether the value reaches what it must."""
        if self.value is None or (self.low is None and self.high is None):
            return None
        return (self.low is None or self.value >= self.low) and (self.high is None or self.value <= self.high)


@dataclass(frozen=True)
class FamilyScore:
    """One family: cases of one clear effect, found ones, wrong names, cases left out and unknown, limit ratio."""

    family: str
    n: int
    found: int
    interval: tuple[float, float]
    wrong: int
    outside: int
    unknown: int
    limit_ratio: float | None
    said: dict[str, int]


@dataclass(frozen=True)
class Score:
    """All measures, by family, and what every case came to."""

    seal: str
    measures: tuple[Measure, ...]
    families: tuple[FamilyScore, ...]
    cases: tuple[dict[str, Any], ...]

    @property
    def ok(self) -> bool:
        """Whether nothing that could be measured misses what it must reach."""
        return all(m.ok is not False for m in self.measures)

    def plain(self) -> dict[str, Any]:
        """Return everything as plain values, each measure with its `ok`."""
        rows = [{**asdict(m), "ok": m.ok} for m in self.measures]
        return {"schema": "mccd-challenge-score/1", **asdict(self), "measures": rows, "ok": self.ok}


def score_challenge(folder: Path, *, so_far: bool = False, first: str | None = None) -> Score:
    """Reveal the truth and return the score; raises ConfigError for a case not run, DataError for a broken seal.

    `so_far` scores the cases before the first that was not run. Cases stand in random order, so these are a fair
    sample, while all that were run would lack those that take long. Those before `first` do not count: what has been
    looked at is blind no more.
    """
    truth = reveal(folder)
    wanted = names = cases_of(folder, first)
    if so_far:
        names = list(takewhile(lambda name: was_run(folder, name), names))
    if not names:
        raise ConfigError(f"case {wanted[0]} of {folder} was not run yet: run the challenge first")
    judged = [judge(folder, name, truth.cases[name]) for name in names]
    ratios = _limit_ratios(judged)
    families = tuple(_family(slug, judged, ratios.get(slug)) for slug in _slugs(judged))
    seal = (folder / "seal.txt").read_text(encoding="utf-8").split()[1]
    return Score(seal, tuple(_measures(judged, families, ratios)), families, tuple(_row(j) for j in judged))


def _of(judged: Sequence[Judged], *strata: str) -> list[Judged]:
    return [j for j in judged if j.case.stratum in strata]


def _slugs(judged: Sequence[Judged]) -> list[str]:
    return sorted({j.case.effects[0].effect for j in _of(judged, "one", "faint", "outside")})


def _share(name: str, hits: Iterable[bool], must: str, low: float | None = None, high: float | None = None) -> Measure:
    marks = list(hits)
    if not marks:
        return Measure(name, None, None, 0, low, high, must)
    k = sum(marks)
    return Measure(name, k / len(marks), share_interval(k, len(marks)), len(marks), low, high, must)


def _median(name: str, groups: Sequence[Sequence[float]], must: str, high: float, scale: float = 1.0) -> Measure:
    """Return the median of all numbers over `scale`; the numbers of one case are resampled together."""
    filled = [np.asarray(g, dtype=float) / scale for g in groups if len(g)]
    if not filled:
        return Measure(name, None, None, 0, None, high, must)
    everything = np.concatenate(filled)
    interval = bootstrap_interval(filled, _middle, np.random.default_rng(0))
    return Measure(name, _middle(everything), interval, everything.size, None, high, must)


def _middle(values: Array) -> float:
    return float(np.median(values))


def _measures(judged: Sequence[Judged], families: Sequence[FamilyScore], ratios: dict[str, float]) -> list[Measure]:
    one, two, none, outside = (_of(judged, s) for s in ("one", "two", "none", "outside"))
    shares = [f.found / f.n for f in families if f.n]
    right = [j for j in _of(judged, "one", "two") if all(j.by_name) and not j.wrong]
    pulls = [abs(p) <= 2.0 for j in right for p in j.pulls]
    full = [j for j in judged if j.case.shape == "full"]
    slowest = max((j.outcome.wall_s for j in full), default=None)
    return [
        _share("named correctly, one effect at >= 2 x its naming limit", [j.right for j in one], ">= 95 %", 0.95),
        Measure("  worst family", min(shares, default=None), None, len(shares), 0.8, None, ">= 80 %"),
        _share("confident wrong name", [bool(j.wrong) for j in judged], "<= 1 %", None, 0.01),
        _share("false alarms on null campaigns", [j.verdict != "consistent" for j in none], "<= 1 %", None, 0.01),
        _share("out-of-library: unknown", [j.verdict == "unknown" for j in outside], ">= 90 %", 0.9),
        _share("two effects at once, both named", [all(j.found) for j in two], ">= 85 %", 0.85),
        _share("parameters within 2 sigma", pulls, "93-97 %", 0.93, 0.97),
        _median("stated variance / Cramer-Rao bound, median", [j.spreads for j in right], "<= 1.3", 1.3),
        _median(
            "squared error / Cramer-Rao bound, median over that of chi²",
            [j.misses for j in right],
            "<= 1.3",
            1.3,
            CHI2_MEDIAN,
        ),
        _median(
            "detection limit / matched-filter bound, median of families", [[r] for r in ratios.values()], "<= 1.5", 1.5
        ),
        _median(
            "held-out error / error of the truth, median",
            [[j.held_out] for j in right if j.held_out is not None],
            "<= 1.05",
            1.05,
        ),
        Measure("slowest diagnosis of a full campaign (s)", slowest, None, len(full), None, 60.0, "<= 60 s"),
        _share("diagnoses that failed", [j.verdict == "failed" for j in judged], "0", None, 0.0),
        _share(
            "named outright although a twin exists",
            [all(j.by_name) for j in one if any(e.twins for e in j.case.effects)],
            "-",
        ),
    ]


def _limit_ratios(judged: Sequence[Judged]) -> dict[str, float]:
    """Return, per family with faint cases, the size that is noticed in half the cases over the computed limit."""
    faint = _of(judged, "faint")
    slugs = sorted({j.case.effects[0].effect for j in faint})
    groups = [[j for j in _of(judged, "faint", "one") if j.case.effects[0].effect == slug] for slug in slugs]
    sizes = [np.array([_relative_size(j) for j in group]) for group in groups]
    seen = [np.array([j.noticed for j in group]) for group in groups]
    return dict(zip(slugs, half_points(sizes, seen).tolist(), strict=True)) if slugs else {}


def _relative_size(judged: Judged) -> float:
    effect = judged.case.effects[0]
    return effect.size / effect.detection_limit


def _family(slug: str, judged: Sequence[Judged], ratio: float | None) -> FamilyScore:
    mine = [j for j in judged if j.case.effects and j.case.effects[0].effect == slug]
    one, faint, outside = (_of(mine, stratum) for stratum in ("one", "faint", "outside"))
    said: dict[str, int] = {}
    for j in one:
        text = "+".join(sorted(effect for effect, _ in j.wrong)) or ("right" if j.right else j.verdict)
        said[text] = said.get(text, 0) + 1
    found = sum(j.right for j in one)
    return FamilyScore(
        family=slug,
        n=len(one),
        found=found,
        interval=share_interval(found, len(one)),
        wrong=sum(bool(j.wrong) for j in (*one, *faint, *outside)),
        outside=len(outside),
        unknown=sum(j.verdict == "unknown" for j in outside),
        limit_ratio=ratio,
        said=said,
    )


def _row(j: Judged) -> dict[str, Any]:
    return {
        "case": j.name,
        "stratum": j.case.stratum,
        "shape": j.case.shape,
        "axes": j.case.axes,
        "hidden": [
            {
                "effect": e.effect,
                "where": e.where,
                "times_detection": e.size / e.detection_limit,
                "times_naming": e.size / e.naming_limit,
                "twins": [slug for slug, _ in e.twins],
            }
            for e in j.case.effects
        ],
        "verdict": j.verdict,
        "right": j.right if j.case.effects else j.verdict == "consistent",
        "wrong": [list(key) for key in j.wrong],
        "pulls": list(j.pulls),
        "held_out": j.held_out,
        "wall_s": j.outcome.wall_s,
        "cpu_s": j.outcome.cpu_s,
        "exit_code": j.outcome.exit_code,
    }
