"""Extra resonance: a mode that the model does not have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sim_backend.effects.base import UNLISTED, Effect, Site, shape, size
from sim_backend.effects.dominant import dominant_block, residues
from sim_backend.effects.view import RecordView
from sim_backend.linear import ModalModel

_DAMPING = (0.005, 0.015, 0.05)
"""Damping ratios that are tried: metal, joints, polymer."""

_NO_PEAK = 0.2
"""Damping ratio above which a mode beside a larger one raises no peak that anybody would call a resonance: its quality
factor is below 2.5."""


@dataclass(frozen=True)
class ExtraResonance(Effect):
    """A mode in parallel to the others, with `participation` times the residue of the dominant one.

    It adds participation · r / (s² + 2 damping_ratio omega s + omega²), r being the dominant mode's inverse inertia,
    so it measures the ratio of the inertias and holds for a rigid body as well.
    """

    name = "extra-resonance"
    family = "structure"
    site = Site.MODEL
    exact = True
    linear_form = True
    symptom = "is a narrow peak at a fixed frequency that grows in proportion to the drive"
    several = True
    beyond: ClassVar = {"damping_ratio": UNLISTED}

    participation: float = size("residue relative to that of the dominant mode")
    frequency_hz: float = shape("undamped natural frequency", 100.0, s=-1, low=1e-6)
    damping_ratio: float = shape("damping ratio", 0.01, low=1e-6, high=1.0)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return the modes that a matched filter finds, and the strongest lines of the residual."""
        lines = [(f, z) for f in view.residual_lines_hz(2) if f > 0.0 for z in _DAMPING]
        return [{"frequency_hz": f, "damping_ratio": z} for f, z in (*view.likely_modes(4, _DAMPING), *lines)]

    @classmethod
    def limits(cls, view: RecordView) -> dict[str, tuple[float, float]]:
        """Return the lowest and the highest damping ratio of an extra resonance: above it no peak is seen.

        What is damped more has no name here: see `beyond`.
        """
        return {"damping_ratio": (1e-6, _NO_PEAK)}

    @classmethod
    def choices(cls, view: RecordView) -> int:
        """Return the number of bins that are compared: every frequency of the residual's spectrum."""
        return view.residual.size // 2

    def retune(self, model: ModalModel, input_index: int, output_index: int) -> ModalModel:
        """Return `model` with the mode appended."""
        if self.is_neutral():
            return model
        dominant = dominant_block(model, input_index, output_index)
        b, c = np.zeros((1, model.n_inputs)), np.zeros((model.n_outputs, 1))
        b[0, input_index] = self.participation * residues(model, input_index, output_index)[dominant]
        c[output_index, 0] = 1.0
        omega = 2.0 * np.pi * self.frequency_hz
        mode = model.with_(
            omega_rad_s=np.array([omega]),
            sigma_1_s=np.array([self.damping_ratio * omega]),
            b=b,
            b_direct=np.zeros_like(b),
            c=c,
            c_rate=np.zeros_like(c),
        )
        return model.beside(mode)
