import re

import pytest

from analysis.paper.numbers import UNIT_SI, paper_tables, parse_numbers
from sim_backend.errors import ConfigError
from sim_backend.model import Quantity, load_model

ROW = '{ key = "a", row = "A", unit = "ms", label = "input", tolerance = 1.0, why = "rounding", value = 2.0 }'


def text(row=ROW, more=""):
    return f'[table."1"]\ntitle = "T"\nnote = ""\nrows = [{row}{more}]\n'


def test_values_come_in_si():
    table = parse_numbers(text(), "here")["1"]
    assert table.value("a") == pytest.approx(2e-3)
    with pytest.raises(ConfigError, match="has no row 'b'; it has a"):
        table.number("b")


@pytest.mark.parametrize(
    ("written", "words"),
    [
        (text(more=f", {ROW}"), "use each key once"),
        (text(ROW.replace('"ms"', '"furlong"')), "furlong"),
        (text(ROW.replace("1.0", "-1.0")), "tolerance -1.0"),
        (text(ROW.replace('"rounding"', '""')), "and why"),
        (text(ROW.replace('"input"', '"guessed"')), "guessed"),
        (text(ROW.replace("value", "valeu")), "valeu"),
        ("[table", "here"),
    ],
)
def test_mistakes_are_named(written, words):
    with pytest.raises(ConfigError, match=re.escape(words)):
        parse_numbers(written, "here")


CHOSEN_IN_THE_CAMPAIGN = (
    "learning time of θx: 10 s in campaigns/paper.toml, chosen knowing what 8 s and 20 s give",
    "length of the feed-forward of Table 6.4: searched in analysis/paper/move_length.py",
)
"""Free settings of campaign and tables that were chosen with the outcome known: what they decide is no prediction."""


def test_every_calibrated_row_names_a_calibrated_parameter_of_the_bench_and_none_is_left_out():
    """The labels are held to the model file: what it calibrates is calibrated here, and nothing else is."""
    sources = [*_calibrated_sources(load_model("as-built")), *CHOSEN_IN_THE_CAMPAIGN]
    rows = [n for table in paper_tables().values() for n in table.rows]
    for row in rows:
        assert (row.label == "calibrated") == bool(row.target), row.key
        assert not row.target or any(row.target in source for source in sources), row.target
    targets = {row.target for row in rows if row.target}
    for source in sources:
        assert any(target in source for target in targets), f"no row is labelled calibrated for: {source}"


def _calibrated_sources(node):
    if isinstance(node, Quantity):
        return [node.source] if node.origin == "calibrated" else []
    if isinstance(node, dict):
        return [s for v in node.values() for s in _calibrated_sources(v)]
    if isinstance(node, list | tuple):
        return [s for v in node for s in _calibrated_sources(v)]
    fields = getattr(node, "__struct_fields__", ())
    return [s for f in fields for s in _calibrated_sources(getattr(node, f))]


def test_a_printed_text_is_the_value():
    for table in paper_tables().values():
        for number in table.rows:
            if number.printed:
                assert float(number.printed) == number.value


def test_units_are_si_factors():
    assert UNIT_SI["N m/mrad^5"] == pytest.approx(UNIT_SI["N m"] / UNIT_SI["mrad"] ** 5)
    assert UNIT_SI["°"] * 180 == pytest.approx(3.141592653589793)
