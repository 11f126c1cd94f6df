import math

import pytest

from analysis.paper.numbers import PaperNumber, PaperTable
from analysis.paper.rows import Ours, build_table, label_counts


def number(key="a", **changes):
    given = {
        "key": key,
        "row": key.upper(),
        "unit": "µrad",
        "label": "predicted",
        "tolerance": 0.5,
        "why": "rounding",
        "value": 2.0,
    }
    return PaperNumber(**{**given, **changes})


def table(*numbers, **ours):
    return build_table("x", PaperTable(title="T", note="", rows=numbers), ours)


@pytest.mark.parametrize(
    ("ours", "bound", "ok"),
    [
        (2.5e-6, False, True),  # on the edge of the tolerance, in floating-point numbers
        (2.51e-6, False, False),
        (1.4e-6, False, False),
        (1.4e-6, True, True),
        (2.51e-6, True, False),
        (math.inf, False, False),
        (math.inf, True, False),
        (math.nan, False, None),
    ],
)
def test_agreement_is_within_the_tolerance_or_below_the_bound(ours, bound, ok):
    row = table(number(upper=bound), a=Ours(ours)).rows[0]
    assert row.ok is row.inside is ok
    assert row.failed is (ok is False)


def test_a_bound_that_is_kept_is_no_agreement_and_one_exceeded_fails():
    kept, above = table(
        number("a", label="bound", upper=True), number("b", label="bound"), a=Ours(0.0), b=Ours(9e-6)
    ).rows
    assert (kept.inside, kept.ok, kept.failed) == (True, None, False)
    assert (above.inside, above.ok, above.failed) == (False, False, True)


@pytest.mark.parametrize(
    ("ours", "upper", "share"),
    [
        # tolerance 0.5 about 2 µrad; the distance to its edges in standard deviations, from a table of the normal curve
        (Ours(2.4e-6, std=0.1e-6), False, 0.8413),
        (Ours(2.6e-6, std=0.1e-6), False, 0.1587),
        (Ours(2.4e-6, std=0.1e-6), True, 0.8413),
        (Ours(2.0e-6, std=0.5e-6), False, 0.6827),
        (Ours(2.0e-6, share=0.405), False, 0.405),
    ],
)
def test_what_the_noise_decides_is_neither_agreement_nor_miss(ours, upper, share):
    made = table(number(upper=upper), a=ours)
    (row,) = made.rows
    assert row.share == pytest.approx(share, abs=1e-4)
    assert row.noisy and row.missed and not row.determined and not row.failed
    assert row.ok is None and row.inside is None
    assert label_counts([made])["predicted"] == (0, 0, 1, 0)


@pytest.mark.parametrize(
    ("ours", "ok"),
    [
        (Ours(2.3e-6, std=0.1e-6), True),
        (Ours(2.7e-6, std=0.1e-6), False),
        (Ours(2.4e-6, share=0.96), True),
        (Ours(2.4e-6), True),
        (Ours(math.inf, std=1e-6), False),
    ],
)
def test_an_answer_that_nearly_every_repeat_gives_stands(ours, ok):
    (row,) = table(number(), a=ours).rows
    assert row.ok is ok and not row.noisy and row.missed is not ok


def test_a_number_that_is_printed_twice_is_counted_once():
    made = table(number("a"), number("b", repeats=("x", "a")), a=Ours(2e-6), b=Ours(2e-6))
    assert label_counts([made])["predicted"] == (1, 0, 0, 0)


def test_worse_is_more_than_noise_could_make_of_equal_numbers():
    given = {key: Ours(1e-6, std=0.1e-6) for key in "abc"}
    own = {"a": Ours(1.2e-6, std=0.1e-6), "b": Ours(1.4e-6, std=0.1e-6), "c": Ours(0.5e-6, std=0.1e-6)}
    numbers = [number(key, requirement=2.0) for key in "abc"]
    made = build_table("x", PaperTable(title="T", note="", rows=tuple(numbers)), given, (), own)
    assert [row.own_worse for row in made.rows] == [False, True, False]


def test_numbers_come_in_the_papers_unit():
    row = table(number(), a=Ours(3e-6, std=1e-7, note="n")).rows[0]
    assert (row.ours, row.std, row.deviation, row.note) == (
        pytest.approx(3.0),
        pytest.approx(0.1),
        pytest.approx(1.0),
        "n",
    )


def test_what_was_not_measured_stays_visible_and_fails_nothing():
    made = table(number("a"), number("b", value=None), a=None, b=Ours(1e-6))
    assert [row.ok for row in made.rows] == [None, None]
    assert not any(row.failed for row in made.rows)
    assert [row["ours"] for row in made.as_json()] == [None, pytest.approx(1.0)]


def test_inputs_and_calibrations_cannot_fail():
    made = table(number("a", label="input"), number("b", label="calibrated"), a=Ours(9e-6), b=Ours(9e-6))
    assert [row.ok for row in made.rows] == [False, False]
    assert not any(row.failed for row in made.rows)
    assert label_counts([made]) == {
        "predicted": (0, 0, 0, 0),
        "calibrated": (0, 1, 0, 0),
        "input": (0, 1, 0, 0),
        "bound": (0, 0, 0, 0),
    }
    folded = PaperTable(title="T", note="", rows=(number(),), folded=True)
    assert label_counts([build_table("x", folded, {"a": Ours(2e-6)})])["predicted"] == (0, 0, 0, 0)


def test_requirements_are_upper_or_lower_limits():
    upper = table(number(requirement=1.7), a=Ours(1.6e-6)).rows[0]
    lower = table(number(requirement=1.7, at_least=True), a=Ours(1.6e-6)).rows[0]
    assert (upper.met, lower.met, table(number(), a=Ours(0.0)).rows[0].met) == (True, False, None)


def test_json_has_no_infinity_and_the_contracts_keys():
    (row,) = table(number(), a=Ours(math.inf)).as_json()
    assert row == {
        "row": "A",
        "paper": 2.0,
        "ours": None,
        "unit": "µrad",
        "label": "predicted",
        "tolerance": 0.5,
        "ok": False,
    }


def test_a_value_without_a_row_is_a_mistake():
    with pytest.raises(KeyError, match="no rows"):
        table(number(), b=Ours(1.0))


def test_the_frame_drops_requirements_where_there_are_none():
    assert "requirement" not in table(number(), a=Ours(1e-6)).frame().columns
    assert table(number(requirement=1.0), a=Ours(1e-6)).frame()["requirement"].tolist() == [1.0]
