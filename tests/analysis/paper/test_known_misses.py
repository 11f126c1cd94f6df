"""Known misses: what a file of them may say, and what becomes of a number that is in it."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from analysis.paper.known_misses import load_known_misses, outcomes
from analysis.paper.numbers import Label, PaperNumber, PaperTable, paper_tables
from analysis.paper.rows import Ours, build_table
from sim_backend.errors import ConfigError

README = Path(__file__).parents[3] / "README.md"


def written(folder: Path, text: str) -> Path:
    path = folder / "known.toml"
    path.write_text(text, encoding="utf-8")
    return path


def number(key: str, label: Label = "predicted", value: float | None = 10.0) -> PaperNumber:
    return PaperNumber(key=key, row=f"row {key}", unit="Hz", label=label, tolerance=1.0, why="test", value=value)


def test_every_state_of_a_number() -> None:
    keys = ("in", "out", "known", "better", "absent", "noisy", "known noisy")
    numbers = (*map(number, keys), number("copied", "input"))
    noisy = Ours(9.5, std=20.0)
    table = build_table(
        "1",
        PaperTable(title="t", note="", rows=numbers),
        {"in": 10.5, "out": 12.0, "known": 8.0, "better": 9.5, "copied": 99.0, "noisy": noisy, "known noisy": noisy},
    )
    known = {("1", "row known"): "softer spring", ("1", "row better"): "was 7 once"}
    known["1", "row known noisy"] = "one step is too few"
    unsure = "not determined by this campaign (9.5 ± 20 Hz); repeat it, or list it as known"
    found = {one.row: (one.state, one.said) for one in outcomes({"1": table}, known)}
    assert found == {
        "row in": ("passed", ""),
        "row out": ("failed", "12 Hz, not within 1 of 10 Hz"),
        "row known": ("known miss", "8 Hz, not within 1 of 10 Hz: softer spring"),
        "row better": ("passes now", ""),
        "row noisy": ("failed", unsure),
        "row known noisy": ("known miss", f"{unsure}: one step is too few"),
        "row absent": ("not measured", "not measured by this campaign"),
    }


def test_what_the_noise_decides_fails_until_it_is_known_be_it_a_prediction_or_a_bound() -> None:
    numbers = number("near"), number("bound", "bound"), number("counted"), number("set", "calibrated")
    near = Ours(10.9, std=0.2)
    given = {"near": near, "bound": near, "counted": Ours(10.0, share=0.4), "set": near}
    table = build_table("1", PaperTable(title="t", note="", rows=numbers), given)
    unsure = (
        "not determined by this campaign (10.9 ± 0.2 Hz, about 69 % of repeats agree); repeat it, or list it as known"
    )
    counted = unsure.replace("10.9 ± 0.2 Hz, about 69", "10 Hz, about 40")
    assert [(one.row, one.state, one.said) for one in outcomes({"1": table}, {})] == [
        ("row near", "failed", unsure),
        ("row bound", "failed", unsure),
        ("row counted", "failed", counted),
    ]
    known = {("1", f"row {key}"): "seen" for key in ("near", "bound", "counted")}
    assert {one.state for one in outcomes({"1": table}, known)} == {"known miss"}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('["9.9"]\n"a" = "b"\n', "no table '9.9'"),
        ('"6.4" = "b"\n', "no table '6.4'"),
        ('["6.4"]\n"2nd order (30 Hz): settlin" = "b"\n', "did you mean '2nd order (30 Hz): settling'"),
        ('["6.4"]\n"2nd order (30 Hz): settling" = " "\n', "has no reason"),
        ('["6.4"]\n"2nd order (30 Hz): settling" = 3\n', "has no reason"),
        ('["6.1"]\n"first mode, measured in the paper" = "b"\n', "labelled calibrated and never fails"),
        ("nonsense", "not valid TOML"),
    ],
)
def test_what_a_file_may_not_say(text: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=re.escape(says)):
        load_known_misses(written(tmp_path, text))


def test_the_file_that_the_readme_shows_is_one(tmp_path: Path) -> None:
    shown = re.search(r"```toml\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert shown is not None
    known = load_known_misses(written(tmp_path, shown[1]))
    assert len(known) == sum(map(len, tomllib.loads(shown[1]).values())) > 0


def test_rows_can_be_told_apart_by_what_they_are_called() -> None:
    for table in paper_tables().values():
        assert len({one.row for one in table.rows}) == len(table.rows)
