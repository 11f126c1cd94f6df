"""Which block of a linear model a shift of stiffness, damping or inertia belongs to."""

from __future__ import annotations

import numpy as np

from sim_backend.effects.base import Array
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel


def residues(model: ModalModel, input_index: int, output_index: int) -> Array:
    """Return each block's residue from one input to one output, shape (m,), in output/input/s².

    It is the numerator of the block's transfer function at s = 0: its DC gain times omega², and for a mechanical mode
    the inverse of its inertia.
    """
    c, c_rate = model.c[output_index], model.c_rate[output_index]
    b, b_direct = model.b[:, input_index], model.b_direct[:, input_index]
    return c * (b + 2.0 * model.sigma_1_s * b_direct) - c_rate * model.omega_rad_s**2 * b_direct


def dominant_block(model: ModalModel, input_index: int, output_index: int) -> int:
    """Return the block with the largest DC gain from one input to one output; a rigid body comes before all others.

    Raises ConfigError when no block connects the two.
    """
    strength = np.abs(residues(model, input_index, output_index))
    if not np.any(strength > 0.0):
        raise ConfigError(
            f"linear model: no mode leads from input {input_index + 1} to output {output_index + 1}; place the effect "
            f"where one does"
        )
    # below 1e-6 rad/s every mode counts as a rigid body
    return int(np.argmax(strength / np.maximum(model.omega_rad_s**2, 1e-12)))
