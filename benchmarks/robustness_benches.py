"""Benches drawn about the one as built: close to it, or as far as a design must survive."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import msgspec
import numpy as np

from sim_backend.model import EffectEntry, Model, Quantity, Value, number

AXES = {"theta_x": 0.0, "theta_y": 90.0}
COLD_K, WARM_K, FAR_COLD_K = 63.5, 77.0, 63.0
FAR_FREQUENCY = 0.01


@dataclass(frozen=True)
class Spread:
    """Relative standard deviations of what is drawn; temperature is uniform over the thermal range."""

    frequency: float = 0.001
    damping: float = 0.05
    participation: float = 0.02
    suspension: float = 0.005
    iron: float = 0.05
    noise: float = 0.05
    sensor_gain: float = 0.001
    modulus_per_k: float = -1e-4

    def times(self, scale: float) -> Spread:
        """Return the spread with every standard deviation `scale` times as large."""
        return Spread(**{k: v if k == "modulus_per_k" else scale * v for k, v in asdict(self).items()})


def drawn_bench(model: Model, spread: Spread, rng: np.random.Generator) -> tuple[Model, dict[str, float]]:
    """Return a bench within `spread` of `model`, at a temperature of its own, and what was drawn of the largest."""
    kelvin = float(rng.uniform(COLD_K, WARM_K))
    # frequencies go with the root of the modulus
    cooled = 1.0 + 0.5 * spread.modulus_per_k * (kelvin - WARM_K)

    def scaled(value: Value, std: float, factor: float = 1.0) -> Value:
        return Quantity(value=number(value) * factor * (1.0 + std * rng.standard_normal()), origin="assumed")

    modes = []
    for mode in model.modes:
        held = "suspension" in mode.label  # the bench has an effect of its own for how its springs soften
        std = np.hypot(spread.frequency, spread.suspension if held else 0.0)
        modes.append(
            msgspec.structs.replace(
                mode,
                frequency_hz=scaled(mode.frequency_hz, float(std), 1.0 if held else cooled),
                decay_rate_1_s=scaled(mode.decay_rate_1_s, spread.damping),
                input={k: scaled(v, spread.participation) for k, v in mode.input.items()},
            )
        )
    relative = {
        "jiles-atherton": ("size", spread.iron),
        "amplifier-noise": ("std", spread.noise),
        "sensor-noise": ("std", spread.noise),
    }

    def drawn(entry: EffectEntry) -> EffectEntry:
        parameters = dict(entry.parameters)
        if entry.effect in relative:
            name, std = relative[entry.effect]
            parameters[name] = scaled(parameters[name], std)
        if entry.effect == "sensor-gain":
            parameters["relative"] = number(parameters["relative"]) + spread.sensor_gain * rng.standard_normal()
        return msgspec.structs.replace(entry, parameters=parameters)

    assert model.hardware is not None
    hardware = msgspec.structs.replace(model.hardware, cold_finger_k=kelvin)
    bench = msgspec.structs.replace(model, modes=modes, effects=[drawn(e) for e in model.effects], hardware=hardware)
    return bench, {"cold_finger_k": kelvin}


def far_bench(
    model: Model, rng: np.random.Generator, frequency: float = FAR_FREQUENCY
) -> tuple[Model, dict[str, float]]:
    """Return a bench as far from `model` as a design must survive, and what was drawn.

    Uniform: every mode's frequency within a part `frequency`, damping ± 20 %, delay up to a sample, temperature;
    log-uniform: amplifier 1 to 5 kHz, noise and hysteresis × 0.5 to 2.
    """
    drawn = {
        "cold_finger_k": float(rng.uniform(FAR_COLD_K, WARM_K)),
        "delay_samples": float(rng.uniform(0.0, 1.0)),
        "amplifier_hz": float(1000.0 * 5.0 ** rng.uniform()),
    }
    factor = {name: float(2.0 ** rng.uniform(-1.0, 1.0)) for name in ("noise", "iron")}
    modes = [
        msgspec.structs.replace(
            mode,
            frequency_hz=number(mode.frequency_hz) * (1.0 + rng.uniform(-frequency, frequency)),
            decay_rate_1_s=number(mode.decay_rate_1_s) * (1.0 + rng.uniform(-0.2, 0.2)),
        )
        for mode in model.modes
    ]
    scaled = {"jiles-atherton": ("size", "iron"), "amplifier-noise": ("std", "noise"), "sensor-noise": ("std", "noise")}

    def changed(entry: EffectEntry) -> EffectEntry:
        if entry.effect not in scaled:
            return entry
        name, kind = scaled[entry.effect]
        value = number(entry.parameters[name]) * factor[kind]
        return msgspec.structs.replace(entry, parameters={**entry.parameters, name: value})

    effects = [changed(entry) for entry in model.effects]
    for dof in AXES:
        seconds = drawn["delay_samples"] / model.sample_rate_hz
        effects.append(EffectEntry(effect="delay", where=dof, parameters={"seconds": seconds}))
        lag: dict[str, Value] = {"time_constant_s": 1.0 / (2.0 * np.pi * drawn["amplifier_hz"])}
        effects.append(EffectEntry(effect="amplifier-lag", where=dof, parameters=lag))
    assert model.hardware is not None
    hardware = msgspec.structs.replace(model.hardware, cold_finger_k=drawn["cold_finger_k"])
    return msgspec.structs.replace(model, modes=modes, effects=effects, hardware=hardware), drawn | factor
