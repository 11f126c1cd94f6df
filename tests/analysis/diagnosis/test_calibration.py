"""Stated probabilities are what names of the committed score were worth."""

from __future__ import annotations

import tomllib

from analysis.diagnosis.calibration import TABLE, calibrated, counted
from benchmarks.calibrate_names import ROOT, SCORES, bins_of, names_of, text_of


def test_the_table_is_what_the_command_makes_of_the_score() -> None:
    names = names_of([ROOT / score for score in SCORES])
    assert TABLE.read_text(encoding="utf-8") == text_of(bins_of(names), SCORES)


def test_every_name_of_the_score_is_in_one_bin() -> None:
    names = names_of([ROOT / score for score in SCORES])
    bins = tomllib.loads(TABLE.read_text(encoding="utf-8"))["bins"]
    assert sum(one["names"] for one in bins) == len(names)
    for one, following in zip(bins, [*bins[1:], {"least": 2.0}], strict=True):
        inside = [right for posterior, right in names if one["least"] <= posterior < following["least"]]
        assert (len(inside), sum(inside)) == (one["names"], one["right"])


def test_a_stated_probability_rises_with_the_posterior_and_stays_below_one() -> None:
    stated = [calibrated(p) for p in (0.0, 0.3, 0.9, 0.99, 0.999, 1.0 - 1e-12, 1.0)]
    assert stated == sorted(stated) and stated[-1] < 0.99
    # below what the score has names of there is nothing to be surer by, and nothing that makes a name impossible
    assert calibrated(0.3) == 0.3


def test_bins_keep_equal_posteriors_together_and_never_fall() -> None:
    names = sorted(
        [(0.9, k % 2 == 0) for k in range(150)] + [(0.95, k % 4 == 0) for k in range(150)] + [(1.0, True)] * 60
    )
    bins = bins_of(names)
    assert [least for least, _, _ in bins] == [0.9]  # 0.95 is worse than 0.9, and 60 are too few for a bin
    assert bins[0][1] == len(names)


def test_the_cases_behind_a_probability_are_those_of_its_bin() -> None:
    one = counted(1.0)
    assert one is not None
    *_, last = tomllib.loads(TABLE.read_text(encoding="utf-8"))["bins"]
    assert (one.names, one.right) == (last["names"], last["right"])
    assert calibrated(1.0) == (one.right + 1.0) / (one.names + 2.0)
    assert one.interval[0] < one.right / one.names < one.interval[1]
    # a posterior below what such names were worth is stated as it is: no case was counted
    assert counted(0.3) is None
