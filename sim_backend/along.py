"""What a structural effect adds to the torque along a given path: the compiled step of the loop, without the loop."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_backend import kernel
from sim_backend.assembly import Places
from sim_backend.effects import make_effect
from sim_backend.model import EffectEntry, number
from sim_backend.wiring import effects_of

Array = NDArray[np.float64]


def torque_along(entry: EffectEntry, angle_rad: Array, rate_hz: float = 10_000.0) -> Array:
    """Return the torque (n,) in N m that an effect adds along `angle_rad` (n,), sampled at `rate_hz`, from its start.

    Raises ConfigError for an effect or a parameter that does not exist.
    """
    effect = make_effect(entry.effect, "path", {k: number(v) for k, v in entry.parameters.items()})
    alone = Places(("path",), ("path",), (), (), np.zeros((0, 1)), np.eye(1), np.eye(1))
    arrays, _ = effects_of([effect], alone)
    out, nothing = np.zeros(angle_rad.size), np.zeros(angle_rad.size)
    speed = np.gradient(angle_rad) * rate_hz
    kernel.contribution_along(arrays, 0, nothing, angle_rad, speed, nothing, 1.0 / rate_hz, out)
    return out
