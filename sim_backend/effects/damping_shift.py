"""Damping shift: the resonance is damped more or less than the model says."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, size
from sim_backend.effects.dominant import dominant_block
from sim_backend.linear import ModalModel


@dataclass(frozen=True)
class DampingShift(Effect):
    """The dominant mode's decay rate times (1 + relative)."""

    name = "damping-shift"
    family = "structure"
    site = Site.MODEL
    exact = True
    linear_form = True
    symptom = "is proportional to the rate and stands at the first resonance only, at any amplitude"

    relative: float = size("relative change of the decay rate", low=-0.99)

    def retune(self, model: ModalModel, input_index: int, output_index: int) -> ModalModel:
        """Return `model` with the dominant mode's damping changed."""
        m = dominant_block(model, input_index, output_index)
        sigma = model.sigma_1_s.copy()
        sigma[m] *= 1.0 + self.relative
        return model.with_(sigma_1_s=sigma)
