"""Hidden effects of the surroundings: vibration, heat and timing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.challenge import laws
from analysis.challenge.families.base import Hidden, Law, Scene, log_uniform, on_axis, sign, some_axis
from analysis.challenge.motion import Excitation, Motion

Array = NDArray[np.float64]


@dataclass(frozen=True)
class VibrationLine(Hidden):
    """A torque at one frequency; its phase is another in every run, as a pump does not wait for a run to start."""

    frequency_hz: float

    slug: ClassVar[str] = "vibration-line"

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a frequency from 5 Hz to a tenth of the sample rate."""
        a = some_axis(rng, scene)
        return cls(a, float(0.02 * scene.u_rms[a]), log_uniform(rng, 5.0, 0.1 * scene.rate_hz))

    def cap(self, scene: Scene) -> float:
        """Up to half the rms command."""
        return float(0.5 * scene.u_rms[self.axis])

    def on_torque(self, drive: Array, excitation: Excitation, rng: np.random.Generator) -> Array:
        """Return the torques with the line."""
        phase = rng.uniform(0.0, 2.0 * np.pi)
        line = self.size * np.sin(2.0 * np.pi * self.frequency_hz * excitation.fine_time_s() + phase)
        return on_axis(drive, self.axis, drive[:, self.axis] + line)

    def truth(self) -> dict[str, float]:
        """Return the frequency."""
        return {"frequency_hz": self.frequency_hz}


@dataclass(frozen=True)
class BroadbandVibration(Hidden):
    """A random torque of rms `size` in a band: white noise through a digital resonator on the fine grid."""

    centre_hz: float
    bandwidth_hz: float

    slug: ClassVar[str] = "broadband-vibration"
    predictable: ClassVar[bool] = False
    random: ClassVar[bool] = True

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a centre between 10 Hz and a 16th of the sample rate and a band of a tenth to a half of it."""
        a = some_axis(rng, scene)
        centre = log_uniform(rng, 10.0, scene.rate_hz / 16.0)
        return cls(a, float(0.02 * scene.u_rms[a]), centre, centre * rng.uniform(0.1, 0.5))

    def cap(self, scene: Scene) -> float:
        """Up to half the rms command."""
        return float(0.5 * scene.u_rms[self.axis])

    def filter(self, fine_s: float) -> tuple[Array, Array]:
        """Return numerator (1,) and denominator (3,) of the resonator that makes unit variance of unit white noise."""
        radius = np.exp(-np.pi * self.bandwidth_hz * fine_s)
        angle = 2.0 * np.pi * self.centre_hz * fine_s
        a1, a2 = -2.0 * radius * np.cos(angle), radius**2
        # variance of an AR(2) process under unit white noise
        variance = (1.0 + a2) / ((1.0 - a2) * ((1.0 + a2) ** 2 - a1**2))
        return np.array([1.0 / np.sqrt(variance)]), np.array([1.0, a1, a2])

    def on_torque(self, drive: Array, excitation: Excitation, rng: np.random.Generator) -> Array:
        """Return the torques with the vibration, already going on when the run begins."""
        lead = int(4.0 / (self.bandwidth_hz * excitation.fine_s))
        white = rng.standard_normal(lead + drive.shape[0])
        shaking = self.size * scipy.signal.lfilter(*self.filter(excitation.fine_s), white)[lead:]
        return on_axis(drive, self.axis, drive[:, self.axis] + shaking)

    def truth(self) -> dict[str, float]:
        """Return rms, centre and width."""
        return {"rms": self.size, "centre_hz": self.centre_hz, "bandwidth_hz": self.bandwidth_hz}


@dataclass(frozen=True)
class ThermalStiffness(Hidden):
    """The stiffness changes by `size` per kelvin."""

    way: float

    slug: ClassVar[str] = "thermal-stiffness-drift"

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a twentieth of the stiffness over the campaign's change of temperature."""
        a = some_axis(rng, scene)
        return cls(a, float(0.05 * scene.stiffness[a] / scene.kelvin), sign(rng))

    def cap(self, scene: Scene) -> float:
        """Up to half the stiffness over the campaign."""
        return float(0.5 * scene.stiffness[self.axis] / scene.kelvin)

    def law(self) -> Law:
        """Return the torque of the changed spring."""
        return Law(laws.THERMAL, self.axis, (self.size * self.way,))

    def truth(self) -> dict[str, float]:
        """Return the coefficient."""
        return {"coefficient": self.size * self.way}


@dataclass(frozen=True)
class ClockError(Hidden):
    """The recorder's clock of one reading is slow or fast by a part `size`."""

    way: float

    slug: ClassVar[str] = "sample-clock-error"

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw what makes one sample over a run."""
        return cls(some_axis(rng, scene), 1.0 / (scene.rate_hz * scene.run_s), sign(rng))

    def cap(self, scene: Scene) -> float:
        """Up to 1 %."""
        return 0.01

    def on_reading(self, reading: Array, motion: Motion, excitation: Excitation, rng: np.random.Generator) -> Array:
        """Return the motion, by a cubic spline through its fine grid, at the wrong times; the last position stays."""
        fine = motion.position[:, self.axis]
        n = reading.shape[0]
        at = np.minimum(np.arange(n) * (1.0 + self.size * self.way) * motion.substeps, fine.size - 1.0)
        spline = scipy.interpolate.make_interp_spline(np.arange(fine.size), fine, k=3)
        return on_axis(reading, self.axis, reading[:, self.axis] + spline(at) - fine[:: motion.substeps])

    def truth(self) -> dict[str, float]:
        """Return the relative error."""
        return {"relative": self.size * self.way}


@dataclass(frozen=True)
class DroppedSamples(Hidden):
    """A part `size` of the readings of one axis does not arrive; the last one that did replaces them."""

    slug: ClassVar[str] = "dropped-samples"
    one_sided: ClassVar[bool] = True
    proportional: ClassVar[bool] = False
    predictable: ClassVar[bool] = False
    smooth: ClassVar[bool] = False

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw one in a hundred."""
        return cls(some_axis(rng, scene), 0.01)

    def cap(self, scene: Scene) -> float:
        """Up to a fifth."""
        return 0.2

    def on_record(self, reading: Array, rng: np.random.Generator) -> Array:
        """Return the readings with some lost."""
        arrived = np.asarray(rng.random(reading.shape[0]) >= self.size)
        arrived[0] = True
        last = np.maximum.accumulate(np.where(arrived, np.arange(arrived.size), 0))
        return on_axis(reading, self.axis, reading[last, self.axis])

    def truth(self) -> dict[str, float]:
        """Return the part."""
        return {"fraction": self.size}


@dataclass(frozen=True)
class ConstantTorque(Hidden):
    """A torque that never changes."""

    way: float

    slug: ClassVar[str] = "constant-torque"

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a twentieth of the rms command."""
        a = some_axis(rng, scene)
        return cls(a, float(0.05 * scene.u_rms[a]), sign(rng))

    def cap(self, scene: Scene) -> float:
        """Up to the rms command."""
        return float(scene.u_rms[self.axis])

    def on_torque(self, drive: Array, excitation: Excitation, rng: np.random.Generator) -> Array:
        """Return the torques with the constant one."""
        return on_axis(drive, self.axis, drive[:, self.axis] + self.size * self.way)

    def truth(self) -> dict[str, float]:
        """Return the torque."""
        return {"torque": self.size * self.way}
