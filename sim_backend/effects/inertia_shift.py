"""Inertia shift: the moving mass is larger or smaller than the model says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim_backend.effects.base import Effect, Site, size
from sim_backend.effects.dominant import dominant_block
from sim_backend.linear import ModalModel


@dataclass(frozen=True)
class InertiaShift(Effect):
    """The dominant mode's inertia times (1 + relative), at the same stiffness and dashpot: its DC gain stays.

    With J the inertia, the block is n(s) / (J s² + d s + k), so omega², 2 sigma and n(s) are all divided by
    1 + relative.
    """

    name = "inertia-shift"
    family = "structure"
    site = Site.MODEL
    exact = True
    linear_form = True
    symptom = "is proportional to the acceleration: nothing at DC, all above the first resonance"

    relative: float = size("relative change of the inertia", low=-0.99)

    def retune(self, model: ModalModel, input_index: int, output_index: int) -> ModalModel:
        """Return `model` with the dominant mode's inertia changed."""
        m = dominant_block(model, input_index, output_index)
        factor = 1.0 + self.relative
        omega, sigma = model.omega_rad_s.copy(), model.sigma_1_s.copy()
        b, b_direct = model.b.copy(), model.b_direct.copy()
        omega[m] /= np.sqrt(factor)
        sigma[m] /= factor
        # n(s) = c ((s + 2 sigma) b_direct + b) has the sigma of the block in it: keep n, not b, in proportion. Written
        # as a change, so that it is exactly zero for no shift.
        b[m] = (b[m] + 2.0 * (model.sigma_1_s[m] - sigma[m]) * b_direct[m]) / factor
        b_direct[m] /= factor
        return model.with_(omega_rad_s=omega, sigma_1_s=sigma, b=b, b_direct=b_direct)
