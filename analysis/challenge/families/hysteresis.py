"""Hidden hysteresis: four descriptions by others that a person would call by the same name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from analysis.challenge import laws
from analysis.challenge.families.base import Hidden, Law, Scene, log_uniform, on_axis, some_axis
from analysis.challenge.motion import Excitation
from sim_backend.jit import njit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BoucWen(Hidden):
    """Hysteresis as Bouc and Wen describe it: smooth, rate-independent."""

    reach: float
    beta: float

    slug: ClassVar[str] = "hysteresis"
    one_sided: ClassVar[bool] = True

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a stroke of a twentieth to two thirds of the largest deflection."""
        a = some_axis(rng, scene)
        reach = log_uniform(rng, 0.05, 0.7) * float(scene.y_peak[a])
        return cls(a, float(0.05 * scene.stiffness[a]), reach, rng.uniform(0.5, 0.8))

    def cap(self, scene: Scene) -> float:
        """Half the suspension's stiffness."""
        return float(0.5 * scene.stiffness[self.axis])

    def law(self) -> Law:
        """Return the torque of the sliding springs."""
        return Law(laws.BOUC_WEN, self.axis, (self.size, self.reach, self.beta))


@dataclass(frozen=True)
class JilesAtherton(Hidden):
    """Magnetic hysteresis, driven by the motion."""

    bend: float
    pinning: float
    reversible: float

    slug: ClassVar[str] = "hysteresis"
    one_sided: ClassVar[bool] = True

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a pinning of 0.1–0.6 of the largest deflection on an anhysteretic curve that bends at 0.5–3 of it."""
        a = some_axis(rng, scene)
        y = float(scene.y_peak[a])
        size = float(0.1 * scene.stiffness[a] * y)
        return cls(a, size, log_uniform(rng, 0.5, 3.0) * y, log_uniform(rng, 0.1, 0.6) * y, rng.uniform(0.05, 0.4))

    def cap(self, scene: Scene) -> float:
        """Up to half the suspension's stiffness, by which the magnetic pull reduces it."""
        return float(1.5 * scene.stiffness[self.axis] * self.bend)

    def law(self) -> Law:
        """Return the magnetic torque."""
        return Law(laws.JILES_ATHERTON, self.axis, (self.size, self.bend, self.pinning, self.reversible))


@dataclass(frozen=True)
class Iwan(Hidden):
    """Hysteresis of thirty sliding springs."""

    reach: float

    slug: ClassVar[str] = "hysteresis"
    one_sided: ClassVar[bool] = True

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a largest stroke of a tenth to once the largest deflection."""
        a = some_axis(rng, scene)
        return cls(a, float(0.05 * scene.stiffness[a]), log_uniform(rng, 0.1, 1.0) * float(scene.y_peak[a]))

    def cap(self, scene: Scene) -> float:
        """Half the suspension's stiffness."""
        return float(0.5 * scene.stiffness[self.axis])

    def law(self) -> Law:
        """Return the torque of all springs."""
        return Law(laws.IWAN, self.axis, (self.size, self.reach))


@njit
def _plays(u, reaches):  # type: ignore[no-untyped-def]
    out = np.zeros(u.size)
    at = np.zeros(reaches.size)
    for k in range(u.size):
        for i in range(reaches.size):
            at[i] = min(max(at[i], u[k] - reaches[i]), u[k] + reaches[i])
            out[k] += at[i]
    return out / reaches.size


@dataclass(frozen=True)
class DriveHysteresis(Hidden):
    """A share `size` of the command passes twenty play operators, evenly spaced up to `reach`, as in a piezo."""

    reach: float

    slug: ClassVar[str] = "hysteresis"
    one_sided: ClassVar[bool] = True

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a largest stroke of a tenth to once the largest command."""
        a = some_axis(rng, scene)
        return cls(a, 0.05, log_uniform(rng, 0.1, 1.0) * float(scene.u_peak[a]))

    def cap(self, scene: Scene) -> float:
        """Up to half the command."""
        return 0.5

    def on_command(self, drive: Array, excitation: Excitation) -> Array:
        """Return the drive with a share that lags."""
        u = np.ascontiguousarray(drive[:: excitation.substeps, self.axis])
        lag = np.repeat(_plays(u, self.reach * np.arange(1.0, 21.0) / 20.0) - u, excitation.substeps)
        return on_axis(drive, self.axis, drive[:, self.axis] + self.size * lag)
