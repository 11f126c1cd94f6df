"""Command quantisation: the drive plays only whole steps."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, shape
from sim_backend.effects.rounding import Rounding
from sim_backend.effects.view import RecordView


@dataclass(frozen=True)
class CommandQuantisation(Rounding, Effect):
    """The command rounded to whole steps; neutral at a step of zero."""

    name = "command-quantisation"
    family = "drive"
    site = Site.COMMAND
    symptom = "is a sawtooth over the command, bounded however large it is"

    step_size: float = shape("smallest change of the output", 0.0, u=1)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return the steps that the residual speaks for, or from a 4096th of the largest command to a quarter of it."""
        steps = view.likely_roundings(4) or [view.u_peak / parts for parts in (4, 32, 256, 4096)]
        return [{"step_size": q} for q in steps]

    @classmethod
    def choices(cls, view: RecordView) -> float:
        """Return among how many steps these were found."""
        return view.rounding_choices()
