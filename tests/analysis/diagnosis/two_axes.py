"""A bench of two axes that have nothing to do with each other, each a mode of its own."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sim_backend.model import Mode, Model, Port

RATE_HZ = 1000.0
AXES = ("x", "y")
FREQUENCY_HZ = {"x": 20.0, "y": 33.0}
DECAY_1_S = 9.0


def two_axes(
    frequency_hz: Mapping[str, float] = FREQUENCY_HZ,
    decay_1_s: Mapping[str, float] = dict.fromkeys(AXES, DECAY_1_S),
    rate_hz: float = RATE_HZ,
    delay_s: float = 0.0,
) -> Model:
    """Return their model, from forces to displacements; DC gain 1 m/N."""
    return Model(
        name="two axes",
        sample_rate_hz=rate_hz,
        inputs=[Port(name=f"force_{a}", unit="N", dof=a) for a in AXES],
        outputs=[Port(name=a, unit="m", dof=a) for a in AXES],
        modes=[
            Mode(
                label=a,
                frequency_hz=frequency_hz[a],
                decay_rate_1_s=decay_1_s[a],
                input={f"force_{a}": (2.0 * np.pi * frequency_hz[a]) ** 2},
                output={a: 1.0},
            )
            for a in AXES
        ],
        delay_s={f"force_{a}": delay_s for a in AXES} if delay_s else {},
    )
