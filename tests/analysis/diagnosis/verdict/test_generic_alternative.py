"""Basis functions in place of what was found: ahead of a confounder, behind the right name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from analysis.diagnosis.pipeline import Options, search_causes
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.search.shortlist import SURE_LEAD
from analysis.diagnosis.verdict.generic_alternative import GenericAlternative, generic_alternatives
from analysis.diagnosis.verdict.judging import judge, outdone
from analysis.diagnosis.verdict.lack_of_fit import ONE_IN_A_MILLION, lacks_of_fit
from sim_backend.effects import NAMED
from tests.analysis.diagnosis.residuals import setting_of
from tests.analysis.diagnosis.two_axes import AXES, DECAY_1_S, FREQUENCY_HZ, RATE_HZ, two_axes

Array = NDArray[np.float64]
ROWS, PERIODS = 1500, 4
OMEGA = 2.0 * np.pi * np.array([FREQUENCY_HZ[a] for a in AXES])
NOISE = 2e-3


def _played(coupling: float = 0.0, friction: float = 0.0, uneven: float = 0.0, exchange: float = 0.0) -> Dataset:
    """Return a drive of both axes that repeats, at two levels, by the Runge-Kutta rule in steps of a quarter sample.

    The drive of the first axis pushes the second by a share of `coupling`; the friction there is `friction`, its drive
    grows by `uneven` with its position, and the axes exchange energy by `exchange`.
    """
    rng, h, fine = np.random.default_rng(8), 0.25 / RATE_HZ, 4
    records = []
    for level in (1.0, 0.4):
        period = level * lfilter([0.3], [1.0, -0.9], rng.standard_normal((ROWS, 2)), axis=0)
        u = np.tile(period, (PERIODS, 1))
        x, v = np.zeros(2), np.zeros(2)
        y = np.empty_like(u)

        def pull(x: Array, v: Array, drive: Array) -> Array:
            own = uneven * drive[1] * x[1] - friction * np.tanh(v[1] / 0.5)
            force = np.array([-2.0 * exchange * x[0] * x[1], coupling * drive[0] + own - exchange * x[0] ** 2])
            return OMEGA**2 * (drive + force - x) - 2.0 * DECAY_1_S * v

        for k in range(u.shape[0]):
            y[k] = x
            for _ in range(fine):
                a1 = pull(x, v, u[k])
                a2 = pull(x + 0.5 * h * v, v + 0.5 * h * a1, u[k])
                a3 = pull(x + 0.5 * h * v + 0.25 * h**2 * a1, v + 0.5 * h * a2, u[k])
                a4 = pull(x + h * v + 0.5 * h**2 * a2, v + h * a3, u[k])
                x = x + h * v + h**2 / 6.0 * (a1 + a2 + a3)
                v = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        y += NOISE * rng.standard_normal(y.shape)
        records.append(Record(f"level {level}", u, y, (Window("all", ROWS, PERIODS * ROWS, False, ROWS),)))
    return Dataset(RATE_HZ, tuple(records))


def _found(data: Dataset, *searched: str) -> Found:
    """Return what a search among these causes alone finds."""
    without = tuple({e.reported() for e in NAMED} - set(searched))
    return search_causes(data, two_axes(), Options(without=without))


def rivals_of(found: Found) -> list[GenericAlternative]:
    return list(generic_alternatives(found.setting, found))


@pytest.mark.parametrize(
    ("hidden", "name", "confounder_in"),
    [
        ({"coupling": 3e-3}, "cross-coupling", "sensor-rotation"),
        ({"friction": 2e-4}, "coulomb-friction", "hysteresis"),
    ],
)
def test_a_right_name_is_never_behind_and_a_stand_in_is(
    hidden: dict[str, float], name: str, confounder_in: str
) -> None:
    """What a neighbour explains of a cause that is not listed one or two basis functions explain better."""
    data = _played(**hidden)
    right = _found(data, name, confounder_in)
    assert [e.reported() for e in right.best.effects] == [name]
    assert all(rival.lead > 0.0 for rival in rivals_of(right))

    wrong = _found(data, confounder_in)
    assert [e.reported() for e in wrong.best.effects] == [confounder_in]
    rivals = rivals_of(wrong)
    assert rivals[0].lead < -SURE_LEAD
    assert judge(wrong, general=rivals).verdict == "unknown"


def test_a_column_that_is_the_law_itself_is_no_rival_of_it() -> None:
    """The command times the position is a basis function, and what an uneven force constant does: one law, one name."""
    found = _found(_played(uneven=0.02), "position-dependent-force-constant")
    assert [e.reported() for e in found.best.effects] == ["position-dependent-force-constant"]
    (rival,) = rivals_of(found)
    assert rival.lead > SURE_LEAD


def test_what_two_axes_exchange_follows_a_product_of_their_motions() -> None:
    """A torque with the square of one position and with both: no way of one axis by itself says that."""
    found = _found(_played(exchange=0.01))
    least = lacks_of_fit(found.setting, found.tuned)[0]
    assert least.what == "a torque that follows products of degrees of freedom"
    assert least.p_value() < ONE_IN_A_MILLION


def test_only_a_rival_that_is_sure_to_be_ahead_fails_a_check() -> None:
    """By log 99 = 4.6 and by half of what random causes may explain; said with its place and what it stands against."""
    noise = np.random.default_rng(0).standard_normal(4000)
    setting, fit = setting_of(np.zeros(4000), noise, noise, 1.0, period=1000)
    found = _found(_played(), "hysteresis")
    found = replace(found, setting=replace(setting, nuisances=[]), best=replace(fit, change=np.zeros(0)))

    def rival(lead: float) -> tuple[GenericAlternative, ...]:
        return (GenericAlternative((0,), ("hysteresis at x",), (("other degrees of freedom", False, 0),), lead),)

    assert outdone(found, rival(-4.0)) == ""
    assert outdone(found, rival(-9.0), random=10.0) == ""
    assert outdone(found, rival(-5.0)) == (
        "a torque that follows other degrees of freedom at x explains the data better than hysteresis at x"
    )
