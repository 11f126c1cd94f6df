"""A study file says what it means, or is refused with the reason."""

from __future__ import annotations

import pytest

from analysis.study.definition import load_study, parse_study
from analysis.study.trial import Job
from sim_backend.errors import ConfigError
from tests.analysis.study.studies import spread

HEAD = 'schema = "mccd-study/1"\nname = "s"\nkind = "settling"\ntrials = 4\n'


def varying(*lines: str) -> str:
    return HEAD + "[[vary]]\n" + "\n".join(lines)


def test_the_grid_is_every_combination_the_last_place_changing_fastest() -> None:
    text = (
        varying('place = "settings.a"', "sweep = [1, 2]") + '\n[[vary]]\nplace = "settings.b"\nsweep = ["x", "y", "z"]'
    )
    study = parse_study(text, "here")
    points = [tuple(p.values()) for p in study.points]
    assert points == [(1, "x"), (1, "y"), (1, "z"), (2, "x"), (2, "y"), (2, "z")]
    assert study.total == 24


def test_more_draws_only_add_trials_behind_those_there_are() -> None:
    few, many = Job.of(spread(3)), Job.of(spread(30))
    assert [few.varied(t) for t in range(6)] == [many.varied(t) for t in range(6)]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x = ", "not valid TOML"),
        (HEAD.replace("mccd-study/1", "mccd-study/9"), "schema"),
        (HEAD.replace("trials = 4", "trials = 0"), "`trials` is 0"),
        (HEAD + "trails = 3", "unknown field `trails`"),
        (HEAD + "seed = -1", "`seed` is -1"),
        (varying('place = "settings.x"'), "nothing: give one of"),
        (varying('place = "settings.x"', "sweep = [1]", "uniform = { low = 0.0, high = 1.0 }"), "give one of"),
        (varying('place = "modes"', "sweep = [1]"), "is not a place"),
        (varying('place = "settings.x"', "sweep = []"), "sweeps over nothing"),
        (varying('place = "model"', "normal = { std = 1.0 }"), "can only be swept"),
        (varying('place = "model.modes[*].frequency_hz"', 'sweep = ["a"]'), "can only take numbers"),
        (varying('place = "settings.x"', "normal = { std = -1.0 }"), "zero or more"),
        (varying('place = "settings.x"', "normal = { std = nan }"), "not finite"),
        (varying('place = "settings.x"', "uniform = { low = 2.0, high = 1.0 }"), "low above high"),
        (
            varying('place = "settings.x"', "sweep = [1]", "[[vary]]", 'place = "settings.x"', "sweep = [2]"),
            "same `place`",
        ),
        (varying('place = "settings.x"', f"sweep = {list(range(10_001))}"), "more than 10000 points"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(text: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_study(text, "study.toml")
    assert words in str(caught.value) and str(caught.value).startswith("study.toml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEAD.replace('"settling"', '"setling"'), "did you mean 'settling'"),
        (HEAD + 'model = "as-bult"', "did you mean 'as-built'"),
        (HEAD + "[limits]\nsettling = 1.0", "did you mean 'settling_s'"),
        (varying('place = "model.modes[z suspension].frequency"', "sweep = [1.0]"), "did you mean 'frequency_hz'"),
        (
            varying('place = "model.modes[z*].frequency_hz"', "sweep = [1.0]", "[[vary]]")
            + '\nplace = "model.modes[*].frequency_hz"\nnormal = { std = 1.0 }',
            "two [[vary]] change",
        ),
        (
            varying('place = "model"', 'sweep = ["as-built", "table-6.4-30"]', "[[vary]]")
            + '\nplace = "model.modes[*].frequency_hz"\nnormal = { std = 1.0 }',
            "different numbers",
        ),
    ],
)
def test_what_does_not_fit_together_is_refused(text: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        Job.of(parse_study(text, "study.toml"))
    assert words in str(caught.value)


def test_a_file_that_is_none_is_told(tmp_path) -> None:
    with pytest.raises(ConfigError, match="name the file of a study"):
        load_study(tmp_path / "none.toml")
    (tmp_path / "bad.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigError, match="UTF-8"):
        load_study(tmp_path / "bad.toml")
