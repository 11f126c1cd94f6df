"""A bench of two axes that have nothing to do with each other, each a mode of its own."""

from __future__ import annotations

import numpy as np

from sim_backend.model import Mode, Model, Port

RATE_HZ = 1000.0
AXES = ("x", "y")
FREQUENCY_HZ = {"x": 20.0, "y": 33.0}
DECAY_1_S = 9.0


def two_axes() -> Model:
    """Return their model, from forces to displacements; DC gain 1 m/N."""
    return Model(
        name="two axes",
        sample_rate_hz=RATE_HZ,
        inputs=[Port(name=f"force_{a}", unit="N", dof=a) for a in AXES],
        outputs=[Port(name=a, unit="m", dof=a) for a in AXES],
        modes=[
            Mode(
                label=a,
                frequency_hz=FREQUENCY_HZ[a],
                decay_rate_1_s=DECAY_1_S,
                input={f"force_{a}": (2.0 * np.pi * FREQUENCY_HZ[a]) ** 2},
                output={a: 1.0},
            )
            for a in AXES
        ],
    )
