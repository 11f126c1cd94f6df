"""Stiffness shift: the springs are stiffer or softer than the model says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim_backend.effects.base import Effect, Site, size
from sim_backend.effects.dominant import dominant_block
from sim_backend.linear import ModalModel


@dataclass(frozen=True)
class StiffnessShift(Effect):
    """The dominant mode's stiffness times (1 + relative): its omega² scales, its inertia (residue) stays."""

    name = "stiffness-shift"
    family = "structure"
    site = Site.MODEL
    exact = True
    linear_form = True
    symptom = "is proportional to the deflection below the first resonance and peaks there, at any amplitude"

    relative: float = size("relative change of the stiffness", low=-0.99)

    def retune(self, model: ModalModel, input_index: int, output_index: int) -> ModalModel:
        """Return `model` with the dominant mode's stiffness changed."""
        m = dominant_block(model, input_index, output_index)
        omega = model.omega_rad_s.copy()
        omega[m] *= np.sqrt(1.0 + self.relative)
        return model.with_(omega_rad_s=omega)
