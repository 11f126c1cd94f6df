"""The library of physical effects: `EFFECTS` is the only list; adding one is a file beside this and a line here.

Other packages may add to it (`sim_backend.plugins`): `library` has theirs too.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from sim_backend.effects.actuator_gain import ActuatorGain
from sim_backend.effects.amplifier_lag import AmplifierLag
from sim_backend.effects.amplifier_noise import AmplifierNoise
from sim_backend.effects.amplifier_saturation import AmplifierSaturation
from sim_backend.effects.apex_noise import ApexNoise
from sim_backend.effects.backlash import Backlash
from sim_backend.effects.base import Aux, Dimension, Effect, Parameter, Site
from sim_backend.effects.bouc_wen import BoucWen
from sim_backend.effects.broadband_vibration import BroadbandVibration
from sim_backend.effects.coil_heating import CoilHeating
from sim_backend.effects.command_quantisation import CommandQuantisation
from sim_backend.effects.constant_torque import ConstantTorque
from sim_backend.effects.coulomb_friction import CoulombFriction
from sim_backend.effects.cross_coupling import CrossCoupling
from sim_backend.effects.cubic_stiffness import CubicStiffness
from sim_backend.effects.damping_shift import DampingShift
from sim_backend.effects.dead_zone import DeadZone
from sim_backend.effects.delay import Delay
from sim_backend.effects.drive_hysteresis import DriveHysteresis
from sim_backend.effects.dropped_samples import DroppedSamples
from sim_backend.effects.end_stop_contact import EndStopContact
from sim_backend.effects.extra_resonance import ExtraResonance
from sim_backend.effects.fringe_jump import FringeJump
from sim_backend.effects.hysteresis import Hysteresis
from sim_backend.effects.inertia_shift import InertiaShift
from sim_backend.effects.jiles_atherton import JilesAtherton
from sim_backend.effects.magnetic_polynomial import MagneticPolynomial
from sim_backend.effects.periodic_sensor_error import PeriodicSensorError
from sim_backend.effects.periodic_torque import PeriodicTorque
from sim_backend.effects.position_dependent_force_constant import PositionDependentForceConstant
from sim_backend.effects.presliding_friction import PreslidingFriction
from sim_backend.effects.sample_clock_error import SampleClockError
from sim_backend.effects.sensor_drift import SensorDrift
from sim_backend.effects.sensor_gain import SensorGain
from sim_backend.effects.sensor_noise import SensorNoise
from sim_backend.effects.sensor_offset import SensorOffset
from sim_backend.effects.sensor_quantisation import SensorQuantisation
from sim_backend.effects.sensor_rotation import SensorRotation
from sim_backend.effects.slow_softening import SlowSoftening
from sim_backend.effects.soft_saturation import SoftSaturation
from sim_backend.effects.stiffness_shift import StiffnessShift
from sim_backend.effects.thermal_stiffness_drift import ThermalStiffnessDrift
from sim_backend.effects.vibration_line import VibrationLine
from sim_backend.effects.viscoelastic_creep import ViscoelasticCreep
from sim_backend.errors import ConfigError, nearest
from sim_backend.plugins import load_plugin, plugin_names, refusal

EFFECTS: tuple[type[Effect], ...] = (
    StiffnessShift,
    DampingShift,
    InertiaShift,
    ExtraResonance,
    CubicStiffness,
    Hysteresis,
    JilesAtherton,
    BoucWen,
    DriveHysteresis,
    CoulombFriction,
    PreslidingFriction,
    ViscoelasticCreep,
    EndStopContact,
    CrossCoupling,
    Backlash,
    PeriodicTorque,
    ActuatorGain,
    PositionDependentForceConstant,
    AmplifierSaturation,
    SoftSaturation,
    AmplifierLag,
    Delay,
    DeadZone,
    CommandQuantisation,
    CoilHeating,
    SensorGain,
    SensorRotation,
    PeriodicSensorError,
    SensorQuantisation,
    FringeJump,
    ApexNoise,
    SensorDrift,
    VibrationLine,
    BroadbandVibration,
    ThermalStiffnessDrift,
    SampleClockError,
    DroppedSamples,
    ConstantTorque,
)
"""What a diagnosis can name, in the order of the library's table."""

NOISES: tuple[type[Effect], ...] = (AmplifierNoise, SensorNoise)
"""What every bench has and no diagnosis names: the noise floor."""

BENCH_ONLY: tuple[type[Effect], ...] = (MagneticPolynomial, SensorOffset)
"""What a model can hold and no diagnosis searches: the paper's own description of an effect, a bench's own zero."""

INSIDE: tuple[type[Effect], ...] = (SlowSoftening,)
"""What a diagnosis can name in the modes themselves, beside a dominant cause (see `analysis.diagnosis.modal`)."""

NAMED: tuple[type[Effect], ...] = (*EFFECTS, *INSIDE)
"""Everything that a diagnosis can name."""

_BY_NAME = {e.name: e for e in (*NAMED, *NOISES, *BENCH_ONLY)}


FAMILIES = ("structure", "drive", "sensor", "surroundings")


def library() -> tuple[type[Effect], ...]:
    """Return EFFECTS and the effects of other packages: everything that a diagnosis searches.

    Raises ConfigError for one of a package that cannot be imported or is not an effect.
    """
    return (*EFFECTS, *(_of_a_package(name) for name in plugin_names("effects", _BY_NAME)))


def named() -> tuple[type[Effect], ...]:
    """Return everything that a diagnosis can name, with the effects of other packages; raises as `library`."""
    return (*library(), *INSIDE)


def effect_class(name: str) -> type[Effect]:
    """Return the effect class of a slug; raises ConfigError with the nearest names when there is none."""
    if name in _BY_NAME:
        return _BY_NAME[name]
    known = (*_BY_NAME, *plugin_names("effects", _BY_NAME))
    if name not in known:
        near = nearest(name, known, 3)
        fix = f"did you mean {', '.join(near)}?" if near else "`mccd model effects` lists them"
        raise ConfigError(f"there is no effect '{name}'; {fix}")
    return _of_a_package(name)


@cache
def _of_a_package(name: str) -> type[Effect]:
    """Return the effect that another package declares; raises ConfigError where it is not one."""
    found = load_plugin("effects", name)
    if not (isinstance(found, type) and issubclass(found, Effect)):
        raise refusal("effects", name, "is not a subclass of sim_backend.effects.base.Effect")
    lacking = [part for part in ("name", "family", "site", "symptom") if not hasattr(found, part)]
    if lacking:
        raise refusal("effects", name, f"does not say its {lacking[0]}")
    if found.name != name or found.family not in FAMILIES:
        raise refusal(
            "effects", name, f"calls itself '{found.name}', of the family '{found.family}' (of {', '.join(FAMILIES)})"
        )
    return found


def make_effect(name: str, where: str, parameters: Mapping[str, float]) -> Effect:
    """Return the effect `name` at `where`.

    Raises ConfigError for an unknown effect or parameter, or a value out of bounds.
    """
    cls = effect_class(name)
    known = cls.parameter_names()
    if not parameters.keys() <= known:
        unknown, has = sorted(set(parameters) - known), ", ".join(p.name for p in cls.parameters())
        raise ConfigError(f"effect {name} has no parameter '{unknown[0]}'; it has: {has or 'none'}")
    return cls(where, **parameters)


__all__ = [
    "BENCH_ONLY",
    "EFFECTS",
    "INSIDE",
    "NAMED",
    "NOISES",
    "Aux",
    "Dimension",
    "Effect",
    "Parameter",
    "Site",
    "effect_class",
    "library",
    "make_effect",
    "named",
]
