"""One cause of this kind as it was found: its parameters, its evidence, and what may be behind it instead."""

from __future__ import annotations

from dataclasses import dataclass

from analysis.diagnosis.noise.whitener import Bands
from sim_backend.effects.base import Effect

FALSE_ALARM = 0.002
"""Chance that any of the causes searched for in this module is named where there is none."""


@dataclass(frozen=True)
class Chance:
    """One cause that changes the variance of the readings: its fitted parameters, and the std of each by its name.

    `evidence` is the natural logarithm of its evidence against nothing, `p_value` the chance of as much without it.
    `allowed` is by how much, at most, it raises the mean square of the whitened residual; `shift` by how many standard
    deviations it moves the readings in all. `rivals` are other explanations of the same, in words, with the logarithm
    of the evidence by which they trail. `louder` is how strong it makes the noise in which other causes have to be
    seen, where they cannot be distinguished from it otherwise.
    """

    effect: Effect
    std: dict[str, float]
    evidence: float
    p_value: float
    allowed: float
    shift: float
    rivals: tuple[tuple[str, float], ...] = ()
    louder: Bands | None = None
