"""What trials say together, against counting by hand and against the definition of each interval."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from analysis.study.definition import parse_study
from analysis.study.store import Store
from analysis.study.summary import Share, summarise
from analysis.study.trial import Job, Outcome

POWER = """
schema = "mccd-study/1"
name = "power"
kind = "diagnosis"
trials = 4
[settings]
hidden = { effect = "coulomb-friction", where = "theta_x", parameters = { torque = 0.0 } }
[[vary]]
place = "settings.hidden.parameters.torque"
sweep = [0.0, 1e-4]
"""
CHOP = 'schema = "mccd-study/1"\nname = "c"\nkind = "chop"\ntrials = 6\n[limits]\naccuracy_rad = 4.0\n'


@pytest.mark.parametrize(("hits", "of"), [(0, 60), (1, 7), (30, 60), (60, 60)])
def test_the_interval_of_a_share_is_where_its_score_reaches_the_normal_quantile(hits: int, of: int) -> None:
    share = Share.count(hits, of)
    assert share.fraction == hits / of
    # Wilson's bounds are the p with (hits/of - p)² = z² p (1 - p) / of
    z = 1.959963984540054
    for p in share.ci95:
        assert (share.fraction - p) ** 2 == pytest.approx(z * z * p * (1.0 - p) / of, abs=1e-12)
    assert share.ci95[0] <= share.fraction <= share.ci95[1]


def test_of_nothing_nothing_is_known() -> None:
    share = Share.count(0, 0)
    assert math.isnan(share.fraction) and share.ci95 == (0.0, 1.0)


def kept(folder: Path, job: Job, outcomes: list[Outcome]) -> Store:
    store = Store(folder, {"kind": "x"}, job.varied_names, job.columns, resume=False)
    store.add(outcomes)
    return store


def test_quantiles_are_order_statistics_and_what_came_to_nothing_keeps_no_limit(tmp_path: Path) -> None:
    job = Job.of(parse_study(CHOP, "study"))
    values = [3.0, math.inf, 1.0, math.nan]
    outcomes = [Outcome(t, "done", "", (), (0.0, 0.0, v, 50.0), 0.1) for t, v in enumerate(values)]
    outcomes.append(Outcome(4, "failed", "unstable", (), (None,) * 4, 0.1))
    outcomes.append(Outcome(5, "broken", "KeyError: 'x'", (), (None,) * 4, 0.1))
    with kept(tmp_path, job, outcomes) as store:
        found = summarise(job, store)
    (point,) = found.points
    accuracy = point.numbers["accuracy_rad"]
    # 1, 3 and infinity (what is not a number was not measured): 2 of 3 keep the limit of 4, 2 more came to nothing
    assert (accuracy.n, accuracy.lowest, accuracy.highest, accuracy.limit) == (3, 1.0, math.inf, 4.0)
    assert accuracy.quantiles == {"q05": 1.0, "median": 3.0, "q95": math.inf}
    assert accuracy.within is not None and (accuracy.within.hits, accuracy.within.of) == (2, 5)
    assert point.numbers["inside_percent"].within is None
    assert (point.done, point.failed, point.broken) == (4, 1, 1)
    assert (found.finished, found.failed, found.broken, found.total) == (6, 1, 1, 6)
    assert [(r.status, r.reason, r.trials, r.first) for r in found.reasons] == [
        ("failed", "unstable", 1, 4),
        ("broken", "KeyError: 'x'", 1, 5),
    ]


def test_quantiles_match_the_definition_on_many_numbers(tmp_path: Path) -> None:
    job = Job.of(parse_study(CHOP.replace("trials = 6", "trials = 101"), "study"))
    values = np.random.default_rng(0).permutation(np.arange(101.0))
    outcomes = [Outcome(t, "done", "", (), (float(v), 0.0, 0.0, 0.0), 0.1) for t, v in enumerate(values)]
    with kept(tmp_path, job, outcomes) as store:
        (point,) = summarise(job, store).points
    # the smallest number that at least this part of all lies at or below
    expected = {"q05": 5.0, "median": 50.0, "q95": 95.0}
    assert point.numbers["stability_3sigma_rad"].quantiles == expected


def test_flags_and_texts_are_counted_per_point(tmp_path: Path) -> None:
    job = Job.of(parse_study(POWER, "study"))
    verdicts = ["consistent", "named", "consistent", "unknown", "consistent", "named", "ambiguous"]
    outcomes = [
        Outcome(
            t,
            "done",
            "",
            (job.point(t)["settings.hidden.parameters.torque"],),
            (v, v != "consistent", v == "named", False, None),
            1.0,
        )
        for t, v in enumerate(verdicts)
    ]
    with kept(tmp_path, job, outcomes) as store:
        found = summarise(job, store)
    null, friction = found.points
    assert null.at == {"settings.hidden.parameters.torque": 0.0}
    # trials 0, 2, 4, 6 are the null, 1, 3, 5 the friction; trial 7 is not there yet
    assert (null.flags["seen"].hits, null.flags["seen"].of) == (1, 4)
    assert (friction.flags["right"].hits, friction.flags["right"].of) == (2, 3)
    assert {k: (s.hits, s.of) for k, s in friction.texts["verdict"].items()} == {"named": (2, 3), "unknown": (1, 3)}
    assert null.numbers["reduction"].n == 0 and found.finished == 7
