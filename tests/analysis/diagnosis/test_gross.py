"""Which kinds of a gross cause are fitted further, and how far a first-order start goes."""

from types import SimpleNamespace

import numpy as np
import pytest

from analysis.diagnosis import gross
from analysis.diagnosis.refit import Problem


class Kind:
    """A fit whose misfit falls along a given course, a round at a time; `asked` counts the rounds."""

    def __init__(self, name, *course, asked=None, values=None):
        self.name, self.course, self.asked = name, course, asked if asked is not None else []
        self.misfit = self.objective = course[0]
        self.change = np.zeros(0)
        self.values = np.zeros(4) if values is None else values
        self.candidates = (SimpleNamespace(effect=SimpleNamespace(name=name), where="x"),)

    def held(self):
        return (self,), np.zeros(0)

    def further(self):
        self.asked.append(self.misfit)
        return Kind(self.name, *(self.course[1:] or self.course), asked=self.asked, values=self.values)


@pytest.fixture
def race(monkeypatch):
    monkeypatch.setattr(gross, "refit", lambda setting, held, *_, **__: held[0].further())
    monkeypatch.setattr(gross, "independent_rows", lambda *_: 200.0)
    return lambda *fits: gross._raced(None, SimpleNamespace(misfit=1000.0), fits, lambda *_: None)  # noqa: SLF001


def test_a_late_starter_that_falls_fast_comes_to_lead(race):
    early, late = Kind("early", 200.0, 190.0, 189.0), Kind("late", 400.0, 150.0, 20.0, 1.0, 0.99)
    order = race(early, late)
    assert [f.name for f in order] == ["late", "early"]
    assert order[0].misfit == 0.99
    # 200 at a pace of 0.2 might have become 40, and 190 at 0.95 is done with
    assert early.asked == [200.0]


def test_who_falls_too_slowly_to_lead_is_left_alone(race):
    best, hopeless = Kind("best", 100.0, 99.0), Kind("hopeless", 900.0, 800.0)
    assert [f.name for f in race(best, hopeless)] == ["best", "hopeless"]
    assert best.asked == [100.0] and hopeless.asked == []


def test_a_race_without_an_end_ends(race):
    runner = Kind("runner", *(0.5**k for k in range(50)))
    assert len(race(runner)) == 1 and 0 < len(runner.asked) < 50


def test_of_two_that_leave_the_same_the_one_with_fewer_numbers_leads(race):
    rich, poor = Kind("rich", 100.0), Kind("poor", 101.0)
    rich.values = np.zeros(8)
    # a hundredth more is worth 200 · 0.01 = 2 beside 4 log 200 = 21
    assert [f.name for f in race(rich, poor)] == ["poor", "rich"]


class Valley(Problem):
    """One knob, one size and one shape, best where knob and size are an eighth of what first order says."""

    def evaluate(self, x):
        return SimpleNamespace(misfit=float((x[0] - 0.125) ** 2 + (x[1] - 0.25) ** 2))


@pytest.mark.parametrize(
    ("start", "expected"),
    [
        ([0.125, 0.25, 7.0], [0.125, 0.25, 7.0]),
        ([1.0, 2.0, 7.0], [0.125, 0.25, 7.0]),
        ([-1.0, -2.0, 7.0], [-1 / 16, -0.125, 7.0]),
    ],
    ids=["good", "too far", "no way there"],
)
def test_a_start_is_halved_until_it_is_better_than_nothing(start, expected):
    scales = [SimpleNamespace(size=True), SimpleNamespace(size=False)]
    problem = Valley(SimpleNamespace(knobs=[None]), (), scales)
    # of the halves of (1, 2) only the third and fourth are nearer to the best than nothing is
    np.testing.assert_array_equal(problem.shortened(np.array(start)), expected)
