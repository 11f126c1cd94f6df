"""In how coarse steps the largest numbers come: of so many digits or bits, and of none."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from analysis.diagnosis.records.lattice import last_place

MOTION = np.random.default_rng(3).standard_normal(8000)
COUNTS = np.rint(MOTION / 0.01)


@pytest.mark.parametrize("digits", [3, 5, 7])
@pytest.mark.parametrize("size", [1.0, 3.3e-4, 2.1e5])
def test_the_step_of_numbers_of_so_many_digits_is_found(digits: int, size: float) -> None:
    written = np.char.mod(f"%.{digits}g", size * MOTION).astype(float)
    decade = np.floor(np.log10(np.max(np.abs(written))))
    assert last_place(written) == pytest.approx(10.0 ** (decade - digits + 1), rel=1e-6)


@pytest.mark.parametrize("unit", [1.0, 1e-3, np.pi / 180.0, 1e-6])
def test_the_step_of_32_bit_numbers_is_found_in_any_unit(unit: float) -> None:
    written = np.float32(0.2 * MOTION)
    assert last_place(written.astype(float) * unit) == pytest.approx(
        float(np.spacing(np.max(written))) * unit, rel=1e-6
    )


@pytest.mark.parametrize(
    "values",
    [
        pytest.param(MOTION, id="all digits"),
        pytest.param(0.37 * np.rint(MOTION / 0.01), id="one step throughout"),
        pytest.param(
            np.where(np.arange(8000) % 50, 0.37 * np.rint(MOTION / 0.01), MOTION), id="one step, some between"
        ),
        pytest.param(np.zeros(8000), id="nothing"),
        pytest.param(np.sign(MOTION) * 0.1, id="two values"),
    ],
)
def test_numbers_that_come_in_no_steps_or_in_one_have_none(values: np.ndarray) -> None:
    """32-bit numbers come in steps of a ten-millionth: what is on a lattice of whole multiples may be such numbers."""
    assert last_place(values) <= 1e-6 * np.max(np.abs(values), initial=0.0)


@pytest.mark.parametrize("size", [1e-310, 1e-300, 1e300])
def test_numbers_at_the_ends_of_the_range_of_floats_are_taken_without_a_warning(size: float) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        assert np.isfinite(last_place(size * MOTION))
