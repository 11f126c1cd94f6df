"""An address is the one that numpy tells."""

from __future__ import annotations

import numpy as np
import pytest

from sim_backend.addresses import address_of_numbers

ARRAYS = {
    "whole": np.zeros((3, 4)),
    "a part": np.zeros((3, 4))[1:],
    "a column": np.zeros((3, 4))[:, 1],
    "across": np.zeros((3, 4)).T,
    "whole numbers": np.arange(5),
    "a single number": np.array(1.0),
}


@pytest.mark.parametrize("name", ARRAYS)
@pytest.mark.parametrize("written", [True, False])
def test_it_is_the_one_that_numpy_tells(name: str, written: bool) -> None:
    array = ARRAYS[name].view()
    array.flags.writeable = written
    assert address_of_numbers(array) == array.ctypes.data


def test_what_has_no_numbers_has_no_address() -> None:
    assert address_of_numbers(np.zeros((3, 0))) == 0
