import math

import pytest

from analysis.pages.formats import exact, shown


@pytest.mark.parametrize(
    ("value", "like", "std", "text"),
    [
        (2.0932, 2.09, 0.015, "2.093"),
        (95.165, 99.69, 0.57, "95.17"),
        (0.1489347, 0.116, None, "0.1489"),
        (327.2, 320.0, None, "327"),
        (-29.855, 29.0, None, "−29.9"),
        (0.00034, None, None, "0.0003400"),
        (2.77e27, None, None, "2.770·10²⁷"),
        (7.8123e-9, 7.28999e-9, 7.2e-10, "7.81·10⁻⁹"),
        (0.0, 1.0, None, "0"),
        (None, 1.0, None, "—"),
        (math.nan, 1.0, None, "—"),
        (math.inf, 1.0, None, "never"),
    ],
)
def test_as_many_digits_as_are_known(value, like, std, text):
    assert shown(value, like=like, std=std) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(2.77e27, "2.77·10²⁷"), (1e8, "1·10⁸"), (0.05, "0.05"), (1750.7, "1750.7"), (-8.5, "−8.5"), (None, "—")],
)
def test_printed_numbers_keep_their_digits(value, text):
    assert exact(value) == text
