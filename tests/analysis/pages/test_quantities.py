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
        (1e-5, "0.00100 %"),
        (2.48e-8, "0.0248 ppm"),
        (-9.99e-6, "-9.99 ppm"),
        (1e-9, "0.00100 ppm"),
        (1e-15, "below 0.001 ppm"),
    ],
)
def test_a_share_has_three_digits_and_few_zeros(part: float, text: str) -> None:
    assert share(part) == text
