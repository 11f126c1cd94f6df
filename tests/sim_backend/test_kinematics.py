"""Sensors and actuators against degrees of freedom: geometry checked on points of a tilted plane."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_backend.errors import ConfigError
from sim_backend.kinematics import (
    POINT_ANGLES_DEG,
    dof_from_points,
    dof_to_sensors,
    forces_to_load,
    load_to_forces,
    points_from_dof,
    sensors_to_dof,
)

RADII = st.floats(1e-3, 1.0)
VECTORS = st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3).map(np.array)


@given(RADII)
def test_closed_form_is_the_inverse(radius_m):
    # condition of the matrix is about 1/radius, so rounding may grow to 1e3 of machine precision
    assert np.allclose(
        dof_from_points(radius_m), np.linalg.inv(points_from_dof(radius_m)), rtol=1e-11, atol=1e-12 / radius_m
    )


@given(RADII, VECTORS)
def test_pairs_undo_each_other(radius_m, vector):
    assert np.allclose(dof_to_sensors(sensors_to_dof(vector, radius_m), radius_m), vector, atol=1e-12)
    assert np.allclose(forces_to_load(load_to_forces(vector, radius_m), radius_m), vector, atol=1e-12)


def test_signs_follow_a_rotated_plane():
    """Heights of points carried by the rotation matrices agree to first order."""
    tilt = 1e-4
    angle = np.deg2rad(POINT_ANGLES_DEG)
    points = 0.03 * np.stack([np.cos(angle), np.sin(angle), np.zeros(3)])
    cos, sin = np.cos(tilt), np.sin(tilt)
    about_x = np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])
    about_y = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    for rotation, dof in ((about_x, [tilt, 0, 0]), (about_y, [0, tilt, 0])):
        # sin(tilt) - tilt = tilt³/6
        assert np.allclose((rotation @ points)[2], dof_to_sensors(np.array(dof), 0.03), atol=0.03 * tilt**3)


@given(RADII, VECTORS, VECTORS)
def test_virtual_work_is_the_same_in_both_coordinates(radius_m, dof, load):
    work = load_to_forces(load, radius_m) @ dof_to_sensors(dof, radius_m)
    assert np.isclose(work, load @ dof, atol=1e-12)


def test_radii_may_differ_and_time_series_pass_through():
    dof = np.random.default_rng(1).normal(size=(7, 3))
    assert np.allclose(sensors_to_dof(dof_to_sensors(dof, 0.02), 0.02), dof)
    assert not np.allclose(sensors_to_dof(dof_to_sensors(dof, 0.02), 0.03), dof)


@pytest.mark.parametrize("radius_m", [0.0, -0.03, np.nan, np.inf])
def test_impossible_radius_is_refused(radius_m):
    with pytest.raises(ConfigError, match="radius"):
        points_from_dof(radius_m)
