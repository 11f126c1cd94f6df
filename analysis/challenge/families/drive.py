"""Hidden effects of the drive: what the amplifiers and actuators make of the commands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.challenge import laws
from analysis.challenge.families.base import Hidden, Law, Scene, log_uniform, on_axis, sign, some_axis
from analysis.challenge.motion import Excitation
from analysis.challenge.plant import Plant

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ActuatorGain(Hidden):
    """The actuator gives more or less than it should."""

    way: float

    slug: ClassVar[str] = "actuator-gain"

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a tenth."""
        return cls(some_axis(rng, scene), 0.1, sign(rng))

    def cap(self, scene: Scene) -> float:
        """Up to 60 %."""
        return 0.6

    def on_command(self, drive: Array, excitation: Excitation) -> Array:
        """Return the drive at another gain."""
        return on_axis(drive, self.axis, drive[:, self.axis] * (1.0 + self.size * self.way))

    def truth(self) -> dict[str, float]:
        """Return `relative`, the error of the actuator gain as a part of the nominal gain."""
        return {"relative": self.size * self.way}


@dataclass(frozen=True)
class ForceConstant(Hidden):
    """The force constant changes with the position: it leans (linear) and droops (quadratic)."""

    angle: float
    reach: float

    slug: ClassVar[str] = "position-dependent-force-constant"
    given: ClassVar[tuple[str, ...]] = ("reach",)

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw any mixture of the two, a tenth at the largest deflection `reach`."""
        a = some_axis(rng, scene)
        return cls(a, 0.1, rng.uniform(0.0, 2.0 * np.pi), float(scene.y_peak[a]))

    def cap(self, scene: Scene) -> float:
        """Up to 40 % at the largest deflection."""
        return 0.4

    def law(self) -> Law:
        """Return what the drive gains with the position."""
        linear, quadratic = self._coefficients()
        return Law(laws.FORCE_CONSTANT, self.axis, (linear, quadratic))

    def truth(self) -> dict[str, float]:
        """Return both coefficients."""
        linear, quadratic = self._coefficients()
        return {"linear": linear, "quadratic": quadratic}

    def _coefficients(self) -> tuple[float, float]:
        return (
            self.size * float(np.cos(self.angle)) / self.reach,
            self.size * float(np.sin(self.angle)) / self.reach**2,
        )


@dataclass(frozen=True)
class Saturation(Hidden):
    """The amplifier gives no more than a limit; `size` is the part of the largest command that it cuts off."""

    u_peak: float

    slug: ClassVar[str] = "amplifier-saturation"
    one_sided: ClassVar[bool] = True
    proportional: ClassVar[bool] = False
    given: ClassVar[tuple[str, ...]] = ("u_peak",)

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a tenth."""
        a = some_axis(rng, scene)
        return cls(a, 0.1, float(scene.u_peak[a]))

    def cap(self, scene: Scene) -> float:
        """Up to 60 % of the largest command."""
        return 0.6

    def on_command(self, drive: Array, excitation: Excitation) -> Array:
        """Return the drive within its limits."""
        limit = self._limit()
        return on_axis(drive, self.axis, np.clip(drive[:, self.axis], -limit, limit))

    def truth(self) -> dict[str, float]:
        """Return the limit."""
        return {"limit": self._limit()}

    def _limit(self) -> float:
        return (1.0 - self.size) * self.u_peak


@dataclass(frozen=True)
class Lag(Hidden):
    """The amplifier follows with a first-order lag of time constant `size`."""

    slug: ClassVar[str] = "amplifier-lag"
    one_sided: ClassVar[bool] = True
    proportional: ClassVar[bool] = False

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw one sample."""
        return cls(some_axis(rng, scene), 1.0 / scene.rate_hz)

    def cap(self, scene: Scene) -> float:
        """Up to half the suspension's time."""
        return float(0.5 / scene.plant.omega_rad_s[self.axis])

    def on_command(self, drive: Array, excitation: Excitation) -> Array:
        """Return the drive's mean over each fine step, behind the held command by the exact exponential."""
        held = drive[:, self.axis]
        keep = np.exp(-excitation.fine_s / self.size)
        # state at the end of each step, and the mean of the exponential between
        end = scipy.signal.lfilter([1.0 - keep], [1.0, -keep], held)
        begin = np.concatenate([[0.0], end[:-1]])
        mean = held + (begin - held) * (self.size / excitation.fine_s) * (1.0 - keep)
        return on_axis(drive, self.axis, mean)

    def truth(self) -> dict[str, float]:
        """Return the time constant."""
        return {"time_constant_s": self.size}


@dataclass(frozen=True)
class Delay(Hidden):
    """The drive acts `size` seconds later."""

    slug: ClassVar[str] = "delay"
    one_sided: ClassVar[bool] = True
    proportional: ClassVar[bool] = False

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw one sample."""
        return cls(some_axis(rng, scene), 1.0 / scene.rate_hz)

    def cap(self, scene: Scene) -> float:
        """Up to half the suspension's time."""
        return float(0.5 / scene.plant.omega_rad_s[self.axis])

    def on_plant(self, plant: Plant) -> Plant:
        """Return the plant with the drive of the axis later."""
        late = plant.delay_s.copy()
        late[self.axis] += self.size
        return plant.with_(delay_s=late)

    def truth(self) -> dict[str, float]:
        """Return the delay."""
        return {"seconds": self.size}


@dataclass(frozen=True)
class DeadZone(Hidden):
    """Commands within ±size are ignored and larger ones lose as much."""

    slug: ClassVar[str] = "dead-zone"
    one_sided: ClassVar[bool] = True
    proportional: ClassVar[bool] = False

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a twentieth of the rms command."""
        a = some_axis(rng, scene)
        return cls(a, float(0.05 * scene.u_rms[a]))

    def cap(self, scene: Scene) -> float:
        """Up to the rms command."""
        return float(scene.u_rms[self.axis])

    def on_command(self, drive: Array, excitation: Excitation) -> Array:
        """Return the drive beyond the zone."""
        u = drive[:, self.axis]
        return on_axis(drive, self.axis, np.sign(u) * np.maximum(np.abs(u) - self.size, 0.0))

    def truth(self) -> dict[str, float]:
        """Return the width."""
        return {"width": self.size}


@dataclass(frozen=True)
class CommandQuantisation(Hidden):
    """The drive plays whole steps of `size` only."""

    slug: ClassVar[str] = "command-quantisation"
    one_sided: ClassVar[bool] = True
    proportional: ClassVar[bool] = False
    smooth: ClassVar[bool] = False

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a twentieth of the rms command."""
        a = some_axis(rng, scene)
        return cls(a, float(0.05 * scene.u_rms[a]))

    def cap(self, scene: Scene) -> float:
        """Up to the rms command."""
        return float(scene.u_rms[self.axis])

    def on_command(self, drive: Array, excitation: Excitation) -> Array:
        """Return the nearest steps."""
        return on_axis(drive, self.axis, self.size * np.rint(drive[:, self.axis] / self.size))

    def truth(self) -> dict[str, float]:
        """Return the step."""
        return {"step_size": self.size}


@dataclass(frozen=True)
class CoilHeating(Hidden):
    """The drive weakens while it works: `size` is the loss of gain when it works at its rms value for long."""

    time_s: float
    u_rms: float

    slug: ClassVar[str] = "coil-heating"
    one_sided: ClassVar[bool] = True
    given: ClassVar[tuple[str, ...]] = ("u_rms",)

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a time of a 50th to a third of a run."""
        a = some_axis(rng, scene)
        return cls(a, 0.05, log_uniform(rng, scene.run_s / 50.0, scene.run_s / 3.0), float(scene.u_rms[a]))

    def cap(self, scene: Scene) -> float:
        """Up to a quarter."""
        return 0.25

    def on_command(self, drive: Array, excitation: Excitation) -> Array:
        """Return the drive, weakened by the heat of its past."""
        u = drive[:, self.axis]
        keep = np.exp(-excitation.fine_s / self.time_s)
        heat = scipy.signal.lfilter([0.0, 1.0 - keep], [1.0, -keep], u**2)
        return on_axis(drive, self.axis, u * (1.0 - self.size / self.u_rms**2 * heat))

    def truth(self) -> dict[str, float]:
        """Return coefficient and time."""
        return {"coefficient": self.size / self.u_rms**2, "time_constant_s": self.time_s}
