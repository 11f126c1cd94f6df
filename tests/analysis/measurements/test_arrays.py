import numpy as np
import pytest

from analysis.measurements.arrays import finite, positive
from sim_backend.errors import DataError


def test_good_arrays_pass_unchanged():
    np.testing.assert_array_equal(finite("x", [[1, 2], [3, 4]], 2), [[1.0, 2.0], [3.0, 4.0]])
    assert positive("rate", 2) == 2.0


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([1.0, np.nan, 2.0], r"entry \(1,\) is not finite"),
        ([1.0, 2.0, -np.inf], r"entry \(2,\) is not finite \(-inf\)"),
        ([-1e300, 1.0], r"entry \(0,\) is -1e\+300, beyond what any sensor reads"),
        ([1.0], r"shape \(1,\)"),
        ([[1.0, 2.0]], "1 dimensions"),
    ],
)
def test_bad_arrays_are_refused_by_name_and_place(values, words):
    with pytest.raises(DataError, match=words):
        finite("torque", values, 1)


@pytest.mark.parametrize("value", [0.0, -1.0, np.inf, np.nan])
def test_only_positive_finite_numbers_pass(value):
    with pytest.raises(DataError, match="rate is"):
        positive("rate", value)
