"""What a setting does for every record, one after the other or side by side."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

from tests.analysis.diagnosis.residuals import setting_of


@pytest.mark.parametrize("workers", [1, 2])
def test_an_overflow_that_is_expected_warns_in_no_thread(workers: int) -> None:
    nothing = np.zeros(50)
    setting = replace(setting_of(nothing, nothing, nothing, 1.0)[0], workers=workers)
    huge = [np.full(3, 1e300), np.full(3, 1e200)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with np.errstate(over="ignore"):
            squares = setting.each(lambda x, power: x**power, huge, [2, 2])
    assert all(np.isinf(found).all() for found in squares)
    with np.errstate(over="raise"), pytest.raises(FloatingPointError):
        setting.each(lambda x: x * x, huge)
