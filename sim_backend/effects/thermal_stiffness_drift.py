"""Thermal stiffness drift: springs soften or harden with the temperature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim_backend.effects.base import Aux, Effect, Site, constant, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    return -p[0] * (aux - p[1]) * position


@dataclass(frozen=True)
class ThermalStiffnessDrift(Effect):
    """Torque -coefficient · (temperature - reference_k) · position.

    The reference is the temperature at which the linear model holds. Another reference is the same as another
    stiffness, so it is a constant and not fitted; over runs at different temperatures it must be one and the same.
    """

    name = "thermal-stiffness-drift"
    family = "surroundings"
    site = Site.STRUCTURE
    symptom = "is proportional to the deflection and follows the temperature"
    aux = Aux.TEMPERATURE
    step = _step

    coefficient: float = size("change of stiffness per kelvin", u=1, y=-1, k=-1)
    reference_k: float = constant("temperature at which the linear model holds", 77.0, k=1)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return the mean temperature as reference, or nothing when the record has none."""
        if view.temperature_k is None:
            return []
        return [{"reference_k": float(np.mean(view.temperature_k))}]
