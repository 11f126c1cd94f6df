"""A misfit with a roof and a plateau: its lowest point and how far it is known, without any slope."""

from __future__ import annotations

import math

import pytest

from analysis.diagnosis.fitting.descent import approached, sharpened

TRUE, SLOPE = 0.3, 1e6
"""Where the roof stands, and by how much the misfit rises per unit."""

CLOSE = 0.1


def roof(x: float) -> float:
    return SLOPE * abs(x - TRUE)


@pytest.mark.parametrize("off", [1e-3, -3e-5, 0.0])
def test_a_roof_is_found_and_as_wide_as_it_is(off: float) -> None:
    """The likelihood falls as exp(-|x| 1e6 / 2), whose mean square is 2 (2e-6)²; the grid is of roots of two."""
    at, deviation = sharpened(roof, TRUE + off, 0.01, CLOSE)
    assert abs(at - TRUE) < 0.1 / SLOPE + 0.01 / 2**24
    assert deviation == pytest.approx(math.sqrt(8.0) * 1e-6, rel=0.15)


def test_terraces_do_not_hold_it_up() -> None:
    """Samples that come out wrong one by one make terraces of height five, wider than the smallest steps tried."""
    at, deviation = sharpened(lambda x: 5.0 * math.floor(roof(x) / 5.0), TRUE + 2e-4, 0.01, CLOSE)
    assert abs(at - TRUE) < 5.0 / SLOPE
    assert 2.5e-6 <= deviation <= 1.2e-5


def test_a_valley_of_the_usual_form_is_as_wide_as_its_curvature_says() -> None:
    """A parabola of deviation 1e-4, of which the grid's steps of the root of two make a tenth more."""
    at, deviation = sharpened(lambda x: ((x - TRUE) / 1e-4) ** 2, TRUE + 3e-3, 0.01, CLOSE)
    assert abs(at - TRUE) < 0.4e-4
    assert deviation == pytest.approx(1e-4, rel=0.15)


def test_where_nothing_ends_it_nothing_is_known() -> None:
    """A misfit that rises by three over the whole reach leaves a quarter of the likelihood at its ends."""
    assert sharpened(lambda x: 3.0 * abs(x - TRUE) / 0.01, TRUE, 0.01, CLOSE)[1] == math.inf


def test_an_approach_ends_near_and_asks_a_third_as_often() -> None:
    """Its steps are a factor of three apart, so that it ends no farther off than the smallest gain beside a roof is."""
    asked = list[float]()

    def counted(x: float) -> float:
        asked.append(x)
        return roof(x)

    assert abs(approached(counted, TRUE, 0.01, CLOSE) - TRUE) <= 0.1 / SLOPE
    assert len(asked) == 1 + 2 * 16
    assert abs(approached(roof, TRUE + 1e-3, 0.01, CLOSE) - TRUE) < 1e-6


def test_a_cusp_that_is_sharper_than_anything_asked_is_known_to_the_finest_distance_and_no_better() -> None:
    """Without noise the next grain may cost all: the deviation was zero then, and its inverse no number."""
    deviation = sharpened(lambda x: 1e30 * abs(x - TRUE), TRUE, 0.01, CLOSE)[1]
    assert 0.0 < deviation <= 0.01
