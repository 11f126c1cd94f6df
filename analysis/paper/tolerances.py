"""How far ours may lie from a printed number: one rule per kind. RULES is the only list; `numbers.toml` names them.

A tolerance follows from what is printed or from the physics that the rule names, never from what came out here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from decimal import Decimal

import numpy as np
import scipy

Given = Mapping[str, float | str]


@dataclass(frozen=True)
class Case:
    """One row: its value, its digits as printed, what its rule is given, and the values of its table by key."""

    value: float
    digits: str
    given: Given
    values: Mapping[str, float]

    def number(self, name: str) -> float:
        """Return a number that the rule is given; raises KeyError when it is missing."""
        return float(self.given[name])

    @property
    def half_unit(self) -> float:
        """Half a unit of the last printed digit."""
        exponent = Decimal(self.digits).as_tuple().exponent
        return 0.5 * 10.0 ** int(exponent)


@dataclass(frozen=True)
class Rule:
    """Why a tolerance is what it is, and how it is computed; without `of` it is stored, and a test computes it again.

    `why` may name what the rule is given in braces.
    """

    why: str
    of: Callable[[Case], float] | None


def _half_period(case: Case) -> float:
    return case.half_unit + 1e3 * 0.5 / case.number("hz")


def _largest_of_many(case: Case) -> float:
    scatter = case.number("scatter") * std_of_largest(int(case.number("count")))
    return case.half_unit + 2.0 * scatter * case.value


def std_of_largest(count: int) -> float:
    """Return the standard deviation of the largest of `count` independent standard normal numbers."""
    x = np.linspace(-9.0, 9.0, 20_001)
    density = count * np.exp(-0.5 * x**2) / math.sqrt(2.0 * math.pi) * scipy.special.ndtr(x) ** (count - 1)
    mean = np.trapezoid(x * density, x)
    return float(np.sqrt(np.trapezoid((x - mean) ** 2 * density, x)))


def _power(case: Case) -> float:
    """By P = (k I / K)² of a force that is set by the peak current: half units of k, I and K, and the power's own."""
    shares = (0.05 / 5.7, 0.005 / 2.75, 0.05 / 7.9)
    return case.half_unit + 2.0 * sum(shares) * case.value


def _among_positions(case: Case) -> float:
    """Twice the deviation of the percentages of the standard end points from their mean at one orientation."""
    groups: dict[str, list[float]] = {}
    for key, value in case.values.items():
        alpha, form, _ = key.split()
        if form.startswith("0:"):
            groups.setdefault(alpha, []).append(value)
    return 2.0 * float(np.sqrt(np.mean([np.var(group, ddof=1) for group in groups.values()])))


RULES: dict[str, Rule] = {
    "rounding": Rule("rounding: half a unit of the last printed digit", lambda case: case.half_unit),
    "about": Rule("'approximately': a unit of the last printed digit", lambda case: 2.0 * case.half_unit),
    "rounding of Table 6.2": Rule(
        "half a printed unit and twice the standard deviation that the rounding of Table 6.2 leaves", None
    ),
    "sweep": Rule("half of the 5 Hz resolution of the paper's sweep", lambda case: 2.5),
    "own measurement": Rule(
        "as far from the finite-element result as the paper's own measurement, and rounding",
        lambda case: abs(case.value - case.values[str(case.given["against"])]) + case.half_unit,
    ),
    "gain": Rule(
        "1.5 %: hysteresis, which the fit cannot hold, changes a gain by about its remanence of 0.7 %; rounding adds "
        "up to 0.5 %",
        lambda case: 0.015 * abs(case.value),
    ),
    "frequency": Rule("0.75 %: half of what a gain or stiffness may change", lambda case: 0.0075 * abs(case.value)),
    "damping": Rule(
        "15 %: a remanence of 0.7 % is a loss factor beside the 5 % of twice the damping ratio",
        lambda case: 0.15 * abs(case.value),
    ),
    "one": Rule("one by definition", lambda case: 1e-12),
    "hand tuning": Rule(
        "10 %: twelve parameters tuned by hand; several combinations give the same loop",
        lambda case: 0.1 * abs(case.value),
    ),
    "copied": Rule("copied", lambda case: 0.0),
    "not computed": Rule("defined in a reference of the paper, not in it: not computed", lambda case: 0.0),
    "not printed": Rule("the paper prints no number in the table, and no simulation wears out", lambda case: 0.0),
    "largest of many": Rule(
        "rounding, and twice the scatter of the largest of {count} values that each scatter by {scatter}",
        _largest_of_many,
    ),
    "half a period": Rule(
        "half a period of the {hz} Hz mode, in whose steps the last exit from the band moves, and rounding",
        _half_period,
    ),
    "power": Rule("rounding of 5.7 N/A, 2.75 A, 7.9 N/√W and of the power, added up", _power),
    "among positions": Rule(
        "twice the scatter of the paper's own percentages of the standard end points at one α", _among_positions
    ),
    "two statements": Rule(
        "the paper itself says {also} elsewhere", lambda case: abs(case.value - case.number("also"))
    ),
    "plot": Rule("less than a plot over {span} dB shows: a hundredth", lambda case: 0.01 * case.number("span")),
}

WIDEST = 0.25
"""Largest tolerance of a prediction, as a share of its value.

Of a number known to a factor of two either way, all ratios being as likely, ln(1.25/0.75)/ln 4 = 37 % would agree by
chance. Where that is more, agreement is not a finding.
"""


def tolerance_of(rule: str, case: Case) -> float | None:
    """Return a rule's tolerance to three digits, or None where it is stored; raises KeyError for an unknown rule."""
    made = RULES[rule].of
    return None if made is None else float(f"{made(case):.3g}")


def why_of(rule: str, given: Given) -> str:
    """Return a rule's reason with what it is given."""
    return RULES[rule].why.format(**{name: f"{v:g}" if isinstance(v, float | int) else v for name, v in given.items()})
