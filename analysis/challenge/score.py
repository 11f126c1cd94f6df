"""The score of a challenge: every measure with its interval beside what it target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

from analysis.challenge.breakdown import Bin, Group, laws, reliability, traits
from analysis.challenge.families import slugs
from analysis.challenge.intervals import half_points
from analysis.challenge.judge import Judged, judge
from analysis.challenge.measures import BINS, REPORTED, Measure, calibration, largest, median, quantile, share
from analysis.challenge.rows import SCHEMA, row_of
from analysis.challenge.run import cases_of, tools, was_run
from analysis.challenge.truth import reveal, sealed
from analysis.diagnosis.tails import share_interval
from sim_backend.errors import ConfigError

CHI2_MEDIAN = 0.4549364231195724
"""Median of the square of a standard normal number: what the median squared error over its variance should be."""


LEAST_NULLS, LEAST_PER_FAMILY = 300, 20
"""Cases that the design demands: with nothing hidden, and with one clear effect of each family."""

FAMILY_SHARE = 0.85
"""What every family target."""

TIME_LIMIT_S = 60.0
"""What one diagnosis of a full campaign may take, on the wall and on two cores."""


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
    """All measures, by family, and what every case came to.

    `laws` and `traits` break the cases of the second generator down, `reliability` the names by what was stated.
    """

    seal: str
    measures: tuple[Measure, ...]
    families: tuple[FamilyScore, ...]
    cases: tuple[dict[str, Any], ...]
    laws: tuple[Group, ...] = ()
    traits: tuple[Group, ...] = ()
    reliability: tuple[Bin, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether every measure meets its requirement, on as many cases as the design demands."""
        return all(m.ok is not False and m.enough for m in self.measures)

    @property
    def too_few(self) -> tuple[str, ...]:
        """The measures with fewer cases than the design demands, in words."""
        return tuple(f"{m.name.strip()} ({m.counted})" for m in self.measures if not m.enough)

    @property
    def version(self) -> str:
        """Version and commit of the tool that diagnosed these cases: what the score is of, whoever scores."""
        return tools([(row["tool_version"], row["tool_commit"]) for row in self.cases])

    def plain(self) -> dict[str, Any]:
        """Return everything as plain values, each measure with its `ok` and whether it has cases `enough`."""
        rows = [{**asdict(m), "ok": m.ok, "enough": m.enough} for m in self.measures]
        return {"schema": SCHEMA, **asdict(self), "measures": rows, "ok": self.ok}


def score_challenge(folder: Path, *, so_far: bool = False, first: str | None = None) -> Score:
    """Reveal the truth and return the score; raises ConfigError for a case not run, DataError for a broken seal.

    `so_far` scores the cases before the first that was not run. Cases are in random order, so these are a fair
    sample, while all that were run would lack those that take long. Those before `first` do not count: cases that have
    been looked at are no longer blind.
    """
    truth = reveal(folder)
    wanted = names = cases_of(folder, first)
    if so_far:
        names = list(takewhile(lambda name: was_run(folder, name), names))
    if not names:
        raise ConfigError(f"case {wanted[0]} of {folder} was not run yet: run the challenge first")
    digest = sealed(folder)
    return score_of([judge(folder, name, truth.cases[name]) for name in names], digest)


def score_of(judged: Sequence[Judged], seal: str) -> Score:
    """Return the score of judged cases, whose truth was sealed as `seal`."""
    ratios = _limit_ratios(judged)
    families = tuple(_family(slug, judged, ratios.get(slug)) for slug in _slugs(judged))
    measures = (*_measures(judged, families, ratios), *_beyond_the_library(judged))
    rows = tuple(row_of(j) for j in judged)
    return Score(seal, measures, families, rows, laws(judged), traits(judged), reliability(judged))


def _of(judged: Sequence[Judged], *strata: str) -> list[Judged]:
    return [j for j in judged if j.case.stratum in strata]


def _slugs(judged: Sequence[Judged]) -> list[str]:
    return sorted({j.case.effects[0].effect for j in _of(judged, "one", "faint", "outside")})


def _measures(judged: Sequence[Judged], families: Sequence[FamilyScore], ratios: dict[str, float]) -> list[Measure]:
    one, two, none, outside = (_of(judged, s) for s in ("one", "two", "none", "outside"))
    right = [j for j in _of(judged, "one", "two") if all(j.by_name) and not j.wrong]
    wrong = [bool(j.wrong) for j in judged]
    # what the readings are granted to be, counts, is there: its name is no alarm
    alarms = [j.verdict != "consistent" and not (j.verdict == "named" and not j.wrong) for j in none]
    return [
        share("named correctly, one effect at >= 2 x its naming limit", _right(one), ">= 97 %", low=0.97, least=1),
        *_by_family(families),
        share("confident wrong name", wrong, "<= 0.5 %", high=0.005, least=1),
        share("false alarms on null campaigns", alarms, "<= 0.5 %", high=0.005, least=LEAST_NULLS),
        share("out-of-library: unknown", [j.verdict == "unknown" for j in outside], ">= 92 %", low=0.92, least=1),
        share("two effects at once, both named", [all(j.found) for j in two], ">= 90 %", low=0.9, least=1),
        share("  both named and nothing else", _right(two)),
        *_probabilities(judged),
        *_parameters(right),
        median(
            "detection limit / matched-filter bound, median of families", [[r] for r in ratios.values()], "<= 1.5", 1.5
        ),
        median(
            "held-out error / error of the truth, median",
            [[j.held_out] for j in right if j.held_out is not None],
            "<= 1.05",
            1.05,
        ),
        *_times([j for j in judged if j.case.shape == "full"]),
        share("diagnoses that failed", [j.verdict == "failed" for j in judged], "0", high=0.0, least=1),
        share(
            "named outright although a twin exists",
            [all(j.by_name) for j in one if any(e.twins for e in j.case.effects)],
        ),
    ]


def _beyond_the_library(judged: Sequence[Judged]) -> list[Measure]:
    """Return what becomes of laws that no library lists and of listed ones with a twist: the second generator's.

    Its campaigns have no shape of the first one's, so processor time is that of all cases.
    """
    if not any(j.case.traits for j in judged):
        return []
    unlisted, twisted = _of(judged, "unlisted"), _of(judged, "twisted")
    told = [j.remainder for j in twisted if all(j.by_name) and j.remainder is not None]
    cpu = [j.outcome.cpu_s for j in judged]
    return [
        share("laws that no library lists: unknown", [j.verdict == "unknown" for j in unlisted], ">= 92 %", low=0.92),
        share("  of these with a wrong name", [bool(j.wrong) for j in unlisted]),
        share("listed with a twist: named and nothing else", _right(twisted)),
        share("  of the named: a lack of fit is stated", told),
        quantile("processor time of any diagnosis, median (s)", cpu, 0.5),
        quantile("  90th percentile (s)", cpu, 0.9),
        largest("  largest (s)", cpu),
    ]


def _right(judged: Sequence[Judged]) -> list[bool]:
    return [j.right for j in judged]


def _by_family(families: Sequence[FamilyScore]) -> list[Measure]:
    """Return the value of the worst family, how many families have too small a value, and how many too few cases."""
    asked = [f for f in families if f.n]
    worst = min(asked, key=lambda f: (f.found / f.n, -f.n), default=None)
    below = sum(f.found / f.n < FAMILY_SHARE for f in asked)
    enough = sum(f.n >= LEAST_PER_FAMILY for f in asked)
    return [
        Measure("  worst family", None, None, 0, FAMILY_SHARE, None, ">= 85 %", 1)
        if worst is None
        else Measure(
            f"  worst family, {worst.family}",
            worst.found / worst.n,
            worst.interval,
            worst.n,
            FAMILY_SHARE,
            None,
            ">= 85 %",
            1,
        ),
        Measure("  families below 85 %", below if asked else None, None, len(asked), None, 0.0, "0", 1),
        Measure(
            f"  families with {LEAST_PER_FAMILY} cases or more",
            enough,
            None,
            enough,
            None,
            None,
            "all",
            len(slugs()),
        ),
    ]


def _probabilities(judged: Sequence[Judged]) -> list[Measure]:
    """Return how often names are right beside how sure they were stated to be, together and by what was stated."""
    names = [name for j in judged for name in j.stated]
    within = [name for j in judged if j.case.stratum != "outside" for name in j.stated]
    binned = [
        calibration(f"  stated {words}", [n for n in names if low <= n[0] and (n[0] < high or high == 1.0)])
        for low, high, words in BINS
    ]
    return [
        calibration("names that are right", names, least=1),
        *binned,
        calibration("  with the cause in the library", within),
    ]


def _parameters(right: Sequence[Judged]) -> list[Measure]:
    """Return how parameters of right names compare with their standard deviations and with the least possible ones."""
    unstated = sum(j.without_std for j in right)
    inside = [abs(pull) <= 2.0 for j in right for pull in j.pulls] + [False] * unstated
    return [
        share("parameters within 2 sigma", inside, "93-97 %", low=0.93, high=0.97, least=1),
        Measure("  of them without a sigma (outside)", unstated, None, len(inside), None, None, REPORTED),
        median("stated variance / Cramer-Rao bound, median", [j.spreads for j in right], "<= 1.1", 1.1),
        median(
            "squared error / Cramer-Rao bound, median over that of chi²",
            [j.misses for j in right],
            "<= 1.3",
            1.3,
            CHI2_MEDIAN,
        ),
    ]


def _times(full: Sequence[Judged]) -> list[Measure]:
    """Return what diagnoses of full campaigns take, on the wall and of the processor."""
    wall, cpu = [j.outcome.wall_s for j in full], [j.outcome.cpu_s for j in full]
    return [
        largest("slowest diagnosis of a full campaign (s)", wall, "<= 60 s", TIME_LIMIT_S),
        share("  within 60 s", [s <= TIME_LIMIT_S for s in wall]),
        quantile("  wall time, median (s)", wall, 0.5),
        quantile("  wall time, 90th percentile (s)", wall, 0.9),
        quantile("  processor time, median (s)", cpu, 0.5),
        quantile("  processor time, 90th percentile (s)", cpu, 0.9),
        largest("  processor time, largest (s)", cpu),
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
