"""Three sensors and three actuators against the three degrees of freedom: (6.1) and (6.2) of the paper.

The text of the paper gives the radii names but not the matrices, so they are derived here from the drawing's
description: three points 120 degrees apart on a circle, at 90, 210 and 330 degrees counted from +x towards
+y, seen from +z. A positive theta_x (right-handed about x) lifts the side of +y, a positive theta_y (about y)
lowers the side of +x:

    z_i = z + y_i theta_x - x_i theta_y            sensors, (6.1) solved for the readings
    M_x = sum y_i F_i,  M_y = -sum x_i F_i,  F_z = sum F_i     the same matrix transposed, by virtual work

With the first point on +y, theta_x is carried by all three points in the ratio 2 : -1 : -1 and theta_y by two
of them only. Small angles: the neglected term is theta^3/3, 0.2 µrad at 8.5 mrad, and belongs to the
calibration of the sensors. Every array ends in an axis of length 3, ordered (theta_x, theta_y, z) or (M_x,
M_y, F_z), and point 1, 2, 3.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_backend.errors import ConfigError

Array = NDArray[np.float64]

POINT_ANGLES_DEG = (90.0, 210.0, 330.0)
"""Where sensors and actuators sit on their circles, from +x towards +y."""

_ANGLES_RAD = np.deg2rad(POINT_ANGLES_DEG)
_COS, _SIN = np.cos(_ANGLES_RAD), np.sin(_ANGLES_RAD)

ASSUMED_RADIUS_M = 0.030
"""Radius of both circles; not printed. Its peak current would give 27 mm, its power 34 mm."""


def points_from_dof(radius_m: float) -> Array:
    """Return the matrix, shape (3, 3), from (theta_x, theta_y, z) to the height of each point in m.

    Raises ConfigError when the radius is not positive. Source: (6.1), inverted.
    """
    if not 0.0 < radius_m < np.inf:
        raise ConfigError(f"radius of the sensors or actuators is {radius_m} m; it must be a finite length above zero")
    out = np.ones((3, 3))
    out[:, 0], out[:, 1] = radius_m * _SIN, -(radius_m * _COS)
    return out


def dof_from_points(radius_m: float) -> Array:
    """Return the inverse of `points_from_dof`, shape (3, 3); closed form, because its columns are orthogonal.

    Raises ConfigError when the radius is not positive. Source: (6.1).
    """
    forward = points_from_dof(radius_m)
    # column lengths squared: sum y² = sum x² = 3 r²/2 and sum 1 = 3
    return forward.T / np.array([1.5 * radius_m**2, 1.5 * radius_m**2, 3.0])[:, None]


def sensors_to_dof(reading_m: Array, sensor_radius_m: float) -> Array:
    """Return (theta_x, theta_y, z) in rad, rad, m from three readings in m, both (..., 3). (6.1)."""
    return reading_m @ dof_from_points(sensor_radius_m).T


def dof_to_sensors(dof: Array, sensor_radius_m: float) -> Array:
    """Return three readings in m from (theta_x, theta_y, z) in rad, rad, m, both (..., 3)."""
    return dof @ points_from_dof(sensor_radius_m).T


def load_to_forces(load: Array, actuator_radius_m: float) -> Array:
    """Return three forces in N from (M_x, M_y, F_z) in N m, N m, N, both (..., 3). (6.2)."""
    # load = P' F, hence F = P (P'P)^-1 load
    return load @ dof_from_points(actuator_radius_m)


def forces_to_load(force_n: Array, actuator_radius_m: float) -> Array:
    """Return (M_x, M_y, F_z) in N m, N m, N from three forces in N, both (..., 3).

    Source: (6.2), inverted. Raises ConfigError when the radius is not finite and positive.
    """
    return force_n @ points_from_dof(actuator_radius_m)
