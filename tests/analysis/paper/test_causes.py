"""Causes of misses: each belongs to rows that are there, and what has none is not explained."""

import re

import pytest

from analysis.paper.causes import NOT_EXPLAINED, cause_of, parse_causes
from analysis.paper.numbers import paper_tables
from sim_backend.errors import ConfigError


def text(*rows):
    return f'[[cause]]\ntext = "softer springs"\nrows = [{", ".join(rows)}]\n'


def test_a_pattern_stands_for_all_its_rows():
    found = parse_causes(text('["6.2-coefficients", "theta_x *"]', '["6.3", "p6"]'), "here")
    of_table = [n.key for n in paper_tables()["6.2-coefficients"].rows if n.key.startswith("theta_x ")]
    assert set(found) == {*(("6.2-coefficients", key) for key in of_table), ("6.3", "p6")}
    assert set(found.values()) == {"softer springs"}


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        (['["6.3", "p7"]'], "here: 'p7' of table 6.3 matches no row"),
        (['["9.9", "p6"]'], "here: 'p6' of table 9.9 matches no row"),
        (['["6.3", "p6"]', '["6.3", "p*"]'], "here: 'p*' of table 6.3 matches a row that has a cause"),
    ],
)
def test_mistakes_are_named(rows, says):
    with pytest.raises(ConfigError, match=re.escape(says)):
        parse_causes(text(*rows), "here")


def test_what_is_bundled_can_be_read_and_anything_else_is_not_explained():
    assert cause_of("6.3", "p6") != NOT_EXPLAINED
    assert cause_of("6.6", "repeatability") == NOT_EXPLAINED
