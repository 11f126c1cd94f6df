"""Delay: the drive acts later than the model says."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, size
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel


@dataclass(frozen=True)
class Delay(Effect):
    """The input's delay grows by `seconds`, or shrinks where the model has one."""

    name = "delay"
    family = "drive"
    site = Site.MODEL
    exact = True
    linear_form = True
    symptom = "leads or lags by a phase proportional to the frequency, at unchanged magnitude"

    seconds: float = size("additional delay", s=1, low=-1.0, high=1.0)

    def retune(self, model: ModalModel, input_index: int, output_index: int) -> ModalModel:
        """Return `model` with the delay of the input changed; raises ConfigError when less than none would be left."""
        delay = model.delay_s.copy()
        delay[input_index] += self.seconds
        if delay[input_index] < 0.0:
            raise ConfigError(
                f"effect {self.name} at {self.where}: seconds is {self.seconds:g}, the model has a delay of "
                f"{model.delay_s[input_index]:g} s; take off no more than that"
            )
        return model.with_(delay_s=delay)
