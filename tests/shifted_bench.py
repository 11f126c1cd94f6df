"""The bench as built with what a design may not know: modes elsewhere, a later drive, a slower amplifier."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from sim_backend.model import EffectEntry, Mode, Model, load_model, number

TILTS = ("theta_x", "theta_y")


def shifted_bench(
    frequency: float = 0.0, *, only: str = "", delay_samples: float = 0.0, amplifier_hz: float | None = None
) -> Model:
    """Return the bench with its modes shifted by a part `frequency`, those whose label contains `only`.

    Both tilts act `delay_samples` later, behind an amplifier of first order at `amplifier_hz`.
    """
    model = load_model("as-built")
    effects: list[EffectEntry] = []
    for dof in TILTS:
        if delay_samples:
            seconds = delay_samples / model.sample_rate_hz
            effects.append(EffectEntry(effect="delay", where=dof, parameters={"seconds": seconds}))
        if amplifier_hz is not None:
            lag_s = 1.0 / (2.0 * math.pi * amplifier_hz)
            effects.append(EffectEntry(effect="amplifier-lag", where=dof, parameters={"time_constant_s": lag_s}))
    return msgspec.structs.replace(
        model, modes=_shifted(model.modes, 1.0 + frequency, only), effects=[*model.effects, *effects]
    )


def _shifted(modes: Sequence[Mode], factor: float, only: str) -> list[Mode]:
    return [
        msgspec.structs.replace(mode, frequency_hz=number(mode.frequency_hz) * factor) if only in mode.label else mode
        for mode in modes
    ]
