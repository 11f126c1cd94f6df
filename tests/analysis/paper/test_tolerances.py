"""Every rule against numbers by hand; the stored ones: test_rounding.py, test_table_6_4.py."""

import numpy as np
import pytest

from analysis.paper.numbers import paper_tables
from analysis.paper.tolerances import RULES, Case, std_of_largest, tolerance_of, why_of


def case(value, digits=None, values=None, **given):
    return Case(value, digits or f"{value:g}", given, values or {})


@pytest.mark.parametrize(
    ("rule", "of", "expected"),
    [
        ("rounding", case(2.75), 0.005),
        ("rounding", case(99.4, "99.40"), 0.005),
        ("rounding", case(320.0), 0.5),
        ("rounding", case(2.77e27, "2.77e+27"), 5e24),
        ("about", case(0.7), 0.1),
        ("sweep", case(1405.0), 2.5),
        # 29.0 printed where 29.6 was measured, and half a unit
        ("own measurement", case(29.0, "29.0", {"m": 29.6}, against="m"), 0.65),
        ("gain", case(-200.0), 3.0),
        ("frequency", case(1440.0), 10.8),
        ("damping", case(0.02), 0.003),
        ("hand tuning", case(-2e-6), 2e-7),
        ("copied", case(500.0), 0.0),
        # 4 ms and half of a printed millisecond
        ("half a period", case(32.0, hz=125.0), 4.5),
        # 2 (0.05/5.7 + 0.005/2.75 + 0.05/7.9) = 3.384 % of 0.116, and 0.0005
        ("power", case(0.116), 0.00443),
        ("two statements", case(12.0, also=9), 3.0),
        ("plot", case(0.0, span=50), 0.5),
        # of two values at each orientation, 1 apart: deviation 1/√2, twice
        ("among positions", case(1.0, values={"0 0:+1 1": 1.0, "0 0:+1 2": 2.0, "0 -1:+1 1": 9.0}), 1.41),
    ],
)
def test_rules_by_hand(rule, of, expected):
    assert tolerance_of(rule, of) == pytest.approx(expected, rel=2e-3)


def test_the_largest_of_many_scatters_as_drawn():
    drawn = np.random.default_rng(3).normal(size=(40_000, 24)).max(axis=1)
    # a deviation of 40,000 draws is known to 0.35 %, fourfold for the skew
    assert std_of_largest(24) == pytest.approx(drawn.std(), rel=0.015)
    assert std_of_largest(1) == pytest.approx(1.0, abs=1e-6)
    assert tolerance_of("largest of many", case(2.0, "2.0", count=1, scatter=0.1)) == pytest.approx(0.45)


def test_every_rule_is_used_and_says_why():
    used = {n.rule for table in paper_tables().values() for n in table.rows}
    assert used == set(RULES)
    for table in paper_tables().values():
        for number in table.rows:
            assert number.why == why_of(number.rule, number.given) and "{" not in number.why


def test_the_scatter_given_for_the_largest_is_that_of_the_calibration():
    from campaigns.calibration import _stability_scatter
    from sim_backend.model import load_model

    given = paper_tables()["6.6"].number("stability").given
    found = float(np.max(_stability_scatter(load_model("as-built"), load_model("design"))))
    assert given["scatter"] == pytest.approx(found, abs=5e-4)
