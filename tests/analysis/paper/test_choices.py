"""The table of choices has a row for every number of the bench, with the value and the origin that the file gives."""

import msgspec
import pytest

from analysis.paper.choices import LABEL_OF, PLAYED, choices, choices_table
from sim_backend.errors import ConfigError
from sim_backend.model import EffectEntry, Quantity, load_model

BENCH = load_model("as-built")


def numbers_of(node):
    """Every number of a model's plain content that has an origin, found without knowing what a model consists of."""
    if isinstance(node, dict) and "value" in node:
        yield node
    elif isinstance(node, dict | list):
        for inner in node.values() if isinstance(node, dict) else node:
            yield from numbers_of(inner)


def test_every_number_of_the_bench_has_a_row_with_its_value_and_source():
    rows = [r for r in choices() if r.places != ("campaign",)]
    assert all(r.what and r.source and r.moves and r.label in ("input", "calibrated", "bound", "assumed") for r in rows)
    told = sorted((r.value, r.source.split(" (bound: ")[0]) for r in rows for _ in r.places)
    held = sorted((float(n["value"]), n["source"]) for n in numbers_of(msgspec.to_builtins(BENCH)))
    assert told == held


def test_a_calibrated_number_is_not_called_an_input_nor_an_assumed_one_printed():
    own = {(float(n["value"]), n["source"]): n["origin"] for n in numbers_of(msgspec.to_builtins(BENCH))}
    for row in choices():
        origin = own.get((row.value, row.source.split(" (bound: ")[0]))
        if origin == "assumed":
            assert row.label in ("assumed", "bound"), row.what
        elif origin == "calibrated":
            assert row.label == "calibrated", row.what
    assert set(LABEL_OF.values()) == {"input", "calibrated", "assumed"}


def test_what_is_chosen_after_seeing_that_the_printed_value_fails_is_calibrated():
    (pinning,) = {r.label for r in choices() if r.what == "jiles-atherton: pinning"}
    assert pinning == "calibrated"


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"modes": [msgspec.structs.replace(BENCH.modes[0], label="theta_x pump")]}, "theta_x pump: frequency_hz"),
        (
            {"effects": [EffectEntry(effect="sensor-drift", where="s1", parameters={"drift": Quantity(value=1e-9)})]},
            "sensor-drift: drift",
        ),
    ],
)
def test_a_number_of_which_nothing_is_told_fails(change, named):
    parameters = {e.effect for e in BENCH.effects}
    assert "sensor-drift" not in parameters
    with pytest.raises(ConfigError, match=f"nothing is said of '{named}'"):
        choices(msgspec.structs.replace(BENCH, **change))


def test_words_about_what_the_bench_does_not_have_fail(monkeypatch):
    from analysis.paper import choices as module

    content = module._content()  # noqa: SLF001
    content["effect"]["backlash"] = {"moves": "nothing"}
    monkeypatch.setattr(module, "_content", lambda: content)
    with pytest.raises(ConfigError, match='effect."backlash"'):
        choices()


def test_choices_of_the_campaign_are_those_that_it_plays():
    values = {r.what: r.value for r in choices() if r.places == ("campaign",)}
    assert tuple(values) == tuple(PLAYED)
    # section 6.3.1 and 6.3.2: 5 ms at 10 kHz, and learning until 4.7 s
    assert values["feed-forward of the bench (samples)"] == 50 and values["learning of θy (s)"] == 4.7


def test_the_table_has_a_line_for_every_choice_and_units():
    rows = choices()
    lines = choices_table(rows).splitlines()
    assert len(lines) == len(rows) + 2
    assert all(line.count("|") - line.count("\\|") == 7 for line in lines)
    (drag,) = [line for line in lines if line.startswith("| `amplifier-lag: time_constant_s`")]
    assert "a1, a2, a3 | 0 s | bound" in drag
