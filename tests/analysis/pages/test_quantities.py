import math

import pytest

from analysis.pages.quantities import share


@pytest.mark.parametrize(
    ("part", "text"),
    [
        (0.15, "15.0 %"),
        (0.000165, "0.0165 %"),
        (88.04, "8804 %"),
        (1.0, "100 %"),
        (0.0, "0 %"),
        (math.nan, "nan %"),
        (-0.0123, "-1.23 %"),
        (1e-15, "0.000000000 %"),
    ],
)
def test_a_share_has_three_digits_and_no_power_of_ten(part: float, text: str) -> None:
    assert share(part) == text
