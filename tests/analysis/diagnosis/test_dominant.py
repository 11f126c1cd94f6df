"""How far the fit of a dominant cause goes on, which of two is preferred, and how far a first-order start goes."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from analysis.diagnosis import dominant
from analysis.diagnosis.fitting.problem import Problem


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
def settled(monkeypatch):
    monkeypatch.setattr(dominant, "refit", lambda setting, held, *_, **__: held[0].further())
    setting: Any = None  # which the refit above does not ask for
    return lambda fit: dominant._settled(setting, fit, lambda *_: None)  # noqa: SLF001


def test_a_fit_goes_on_while_it_gains(settled):
    fit = Kind("best", 400.0, 150.0, 20.0, 19.9, 19.0)
    assert settled(fit).misfit == 19.9  # the last steps gained 0.5 %
    assert fit.asked == [400.0, 150.0, 20.0]


def test_a_fit_that_falls_for_ever_ends(settled):
    fit = Kind("runner", *(0.5**k for k in range(50)))
    assert settled(fit).misfit < 0.1 and len(fit.asked) < 10


def cost(fit: Any, rows: float) -> float:
    return dominant._cost(fit, rows)  # noqa: SLF001


def test_of_two_that_leave_the_same_the_one_with_fewer_numbers_leads():
    rich, poor = Kind("rich", 100.0, values=np.zeros(8)), Kind("poor", 101.0)
    # a hundredth more is worth 200 · 0.01 = 2 beside 4 log 200 = 21
    assert cost(poor, 200.0) < cost(rich, 200.0) - 19.0
    assert cost(poor, 1e5) > cost(rich, 1e5)


class Valley(Problem):
    """One nuisance, one size and one shape, best where nuisance and size are an eighth of what first order says."""

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
    scales: list[Any] = [SimpleNamespace(size=True), SimpleNamespace(size=False)]
    setting: Any = SimpleNamespace(nuisances=[None])
    problem = Valley(setting, (), scales)
    # of the halves of (1, 2) only the third and fourth are nearer to the best than nothing is
    np.testing.assert_array_equal(problem.shortened(np.array(start)), expected)
