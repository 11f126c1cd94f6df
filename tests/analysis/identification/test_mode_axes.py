"""A mode belongs to the axis that it moves most, whatever the units of the axes are."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.identification.mode_axes import axes_of_modes
from sim_backend.linear import ModalModel
from tests.small_bench import MODES, bench_model


def test_each_mode_of_three_axes_in_rad_and_m():
    assert axes_of_modes(bench_model().linear(), list(MODES)) == tuple(MODES)


@pytest.mark.parametrize("unit", [1.0, 1e6])
def test_small_coupling_is_none(unit):
    """The second reading and the second drive are in another unit; each mode moves 3 % of the other axis."""
    shape = np.array([[1.0, 0.03], [-0.03, 1.0]])
    scale = np.array([1.0, unit])
    none = np.zeros((2, 2))
    model = ModalModel(
        np.array([60.0, 90.0]), np.array([1.0, 1.0]), shape / scale, none, (shape / scale).T, none, none, np.zeros(2)
    )
    assert axes_of_modes(model, ["x", "z"]) == ("x", "z")


def test_a_mode_that_moves_both_names_both():
    shape = np.array([[1.0, 0.9], [-0.9, 1.0]])
    none = np.zeros((2, 2))
    model = ModalModel(np.array([60.0, 90.0]), np.array([1.0, 1.0]), shape, none, shape.T, none, none, np.zeros(2))
    assert axes_of_modes(model, ["x", "z"]) == ("x, z", "x, z")
    assert axes_of_modes(model, ["x", "x"]) == ("x", "x")
