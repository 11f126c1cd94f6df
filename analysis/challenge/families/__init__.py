"""What can be hidden: `FAMILIES` is the only list; adding one is a class and a line here."""

from __future__ import annotations

from analysis.challenge.families.base import Hidden, Scene
from analysis.challenge.families.drive import (
    ActuatorGain,
    CoilHeating,
    CommandQuantisation,
    DeadZone,
    Delay,
    ForceConstant,
    Lag,
    Saturation,
)
from analysis.challenge.families.hysteresis import BoucWen, DriveHysteresis, Iwan, JilesAtherton
from analysis.challenge.families.sensor import (
    ApexNoise,
    FringeJump,
    PeriodicError,
    SensorDrift,
    SensorGain,
    SensorQuantisation,
    SensorRotation,
)
from analysis.challenge.families.structure import (
    Cogging,
    Creep,
    CrossCoupling,
    CubicStiffness,
    DampingShift,
    EndStop,
    ExtraResonance,
    Friction,
    InertiaShift,
    Play,
    StiffnessShift,
)
from analysis.challenge.families.surroundings import (
    BroadbandVibration,
    ClockError,
    ConstantTorque,
    DroppedSamples,
    ThermalStiffness,
    VibrationLine,
)
from sim_backend.errors import ConfigError

FAMILIES: tuple[type[Hidden], ...] = (
    StiffnessShift,
    DampingShift,
    InertiaShift,
    ExtraResonance,
    CubicStiffness,
    BoucWen,
    JilesAtherton,
    Iwan,
    DriveHysteresis,
    Friction,
    Creep,
    EndStop,
    CrossCoupling,
    Play,
    Cogging,
    ActuatorGain,
    ForceConstant,
    Saturation,
    Lag,
    Delay,
    DeadZone,
    CommandQuantisation,
    CoilHeating,
    SensorGain,
    SensorRotation,
    PeriodicError,
    SensorQuantisation,
    FringeJump,
    ApexNoise,
    SensorDrift,
    VibrationLine,
    BroadbandVibration,
    ThermalStiffness,
    ClockError,
    DroppedSamples,
    ConstantTorque,
)
"""Every hidden effect. Several may share a slug: different physics that a person would call by the same name."""


def slugs() -> tuple[str, ...]:
    """Return the names of all causes, each once, in the order of FAMILIES."""
    return tuple(dict.fromkeys(f.slug for f in FAMILIES))


def members(slug: str) -> tuple[type[Hidden], ...]:
    """Return the effects that are called `slug`; raises ConfigError naming the slugs there are."""
    found = tuple(f for f in FAMILIES if f.slug == slug)
    if not found:
        raise ConfigError(f"there is no family '{slug}' to hide; families: {', '.join(slugs())}")
    return found


__all__ = ["FAMILIES", "Hidden", "Scene", "members", "slugs"]
