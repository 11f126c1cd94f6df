"""Hidden effects of the structure: modes that differ from the nominal model, and torques that depend on the motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from analysis.challenge import laws
from analysis.challenge.families.base import Coupled, Hidden, Law, Scene, log_uniform, on_axis, sign, some_axis
from analysis.challenge.motion import Excitation
from analysis.challenge.plant import Plant

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Shift(Hidden):
    """A relative change of one property of the suspension of an axis."""

    way: float

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        return cls(some_axis(rng, scene), 0.1, sign(rng))

    def cap(self, scene: Scene) -> float:
        return 0.6

    def truth(self) -> dict[str, float]:
        return {"relative": self.size * self.way}


@dataclass(frozen=True)
class StiffnessShift(_Shift):
    """The suspension is stiffer or softer."""

    slug: ClassVar[str] = "stiffness-shift"

    def on_plant(self, plant: Plant) -> Plant:
        """Return the plant with omega² of the suspension changed."""
        omega = plant.omega_rad_s.copy()
        omega[self.axis] = np.sqrt(omega[self.axis] ** 2 * (1.0 + self.size * self.way))
        return plant.with_(omega_rad_s=omega)


@dataclass(frozen=True)
class DampingShift(_Shift):
    """The suspension is damped more or less."""

    slug: ClassVar[str] = "damping-shift"

    def cap(self, scene: Scene) -> float:
        """Return the largest relative change: 0.9 downwards, 3 upwards."""
        return 0.9 if self.way < 0.0 else 3.0

    def on_plant(self, plant: Plant) -> Plant:
        """Return the plant with the suspension's decay rate changed."""
        sigma = plant.sigma_1_s.copy()
        sigma[self.axis] *= 1.0 + self.size * self.way
        return plant.with_(sigma_1_s=sigma)


@dataclass(frozen=True)
class InertiaShift(_Shift):
    """The suspended mass is larger or smaller, on the same spring and dashpot."""

    slug: ClassVar[str] = "inertia-shift"

    def on_plant(self, plant: Plant) -> Plant:
        """Return the plant with the suspension's mode over another inertia."""
        ratio = 1.0 / (1.0 + self.size * self.way)
        omega, sigma, b = plant.omega_rad_s.copy(), plant.sigma_1_s.copy(), plant.b.copy()
        omega[self.axis] *= ratio**0.5
        sigma[self.axis] *= ratio
        b[self.axis] *= ratio
        return plant.with_(omega_rad_s=omega, sigma_1_s=sigma, b=b)


@dataclass(frozen=True)
class ExtraResonance(Hidden):
    """A mode that the nominal model does not have, between the suspension's and three times the flexible one's."""

    omega_rad_s: float
    damping_ratio: float

    slug: ClassVar[str] = "extra-resonance"

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a frequency that is not within 15 % of a known mode."""
        axis = some_axis(rng, scene)
        known = scene.plant.omega_rad_s
        low = 1.5 * float(known[axis])
        high = min(3.0 * float(np.max(known)), 2.0 * np.pi * 0.2 * scene.rate_hz)
        while True:
            omega = log_uniform(rng, low, high)
            if np.all(np.abs(np.log(omega / known)) > 0.15):
                return cls(axis, 0.05, omega, log_uniform(rng, 0.004, 0.04))

    def cap(self, scene: Scene) -> float:
        """As much as the suspension itself."""
        return 1.0

    def on_plant(self, plant: Plant) -> Plant:
        """Return the plant with the mode appended, moved and seen by its own axis alone."""
        b, c = np.zeros(plant.n_axes), np.zeros(plant.n_axes)
        b[self.axis] = self.size * plant.b[self.axis, self.axis] * plant.c[self.axis, self.axis]
        c[self.axis] = 1.0
        return plant.with_mode(self.omega_rad_s, self.damping_ratio * self.omega_rad_s, b, c)

    def truth(self) -> dict[str, float]:
        """Return all three parameters."""
        return {
            "participation": self.size,
            "frequency_hz": self.omega_rad_s / (2.0 * np.pi),
            "damping_ratio": self.damping_ratio,
        }


@dataclass(frozen=True)
class CubicStiffness(Hidden):
    """A hardening or softening spring."""

    way: float

    slug: ClassVar[str] = "cubic-stiffness"

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a tenth of the stiffness at the largest deflection."""
        a = some_axis(rng, scene)
        return cls(a, float(0.1 * scene.stiffness[a] / scene.y_peak[a] ** 2), sign(rng))

    def cap(self, scene: Scene) -> float:
        """Up to a quarter of the stiffness at the largest deflection: a softening spring must still hold."""
        return float(0.25 * scene.stiffness[self.axis] / scene.y_peak[self.axis] ** 2)

    def law(self) -> Law:
        """Return the cubic torque."""
        return Law(laws.CUBIC, self.axis, (self.size * self.way,))

    def truth(self) -> dict[str, float]:
        """Return the coefficient."""
        return {"stiffness": self.size * self.way}


@dataclass(frozen=True)
class Friction(Hidden):
    """Dry friction with bristles that give a little before they slip, and slightly more friction at rest."""

    give: float
    at_rest: float
    stribeck_rate: float

    slug: ClassVar[str] = "coulomb-friction"
    one_sided: ClassVar[bool] = True
    given: ClassVar[tuple[str, ...]] = ("at_rest", "stribeck_rate")

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw bristles that give 0.1–0.5 % of the rms deflection and up to a tenth more friction at rest."""
        a = some_axis(rng, scene)
        give = log_uniform(rng, 1e-3, 5e-3) * float(scene.y_rms[a])
        rate = log_uniform(rng, 3e-3, 3e-2) * float(scene.rate_rms[a])
        return cls(a, float(0.02 * scene.stiffness[a] * scene.y_rms[a]), give, rng.uniform(1.0, 1.1), rate)

    def cap(self, scene: Scene) -> float:
        """Up to half the torque that the rms deflection takes: more would hold the axis still."""
        return float(0.5 * scene.stiffness[self.axis] * scene.y_rms[self.axis])

    def law(self) -> Law:
        """Return the torque of the bristles."""
        stiffness = self.size / self.give
        return Law(laws.FRICTION, self.axis, (self.size, self.at_rest, stiffness, self.stribeck_rate))

    def truth(self) -> dict[str, float]:
        """Return the level in motion."""
        return {"torque": self.size}


@dataclass(frozen=True)
class Creep(Hidden):
    """A part of the stiffness relaxes."""

    time_s: float

    slug: ClassVar[str] = "viscoelastic-creep"
    one_sided: ClassVar[bool] = True

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a time from a 200th to a fifth of a run, longer than the suspension's period."""
        a = some_axis(rng, scene)
        shortest = max(scene.run_s / 200.0, 1.0 / float(scene.plant.omega_rad_s[a]))
        return cls(a, float(0.05 * scene.stiffness[a]), log_uniform(rng, shortest, scene.run_s / 5.0))

    def cap(self, scene: Scene) -> float:
        """Half the stiffness."""
        return float(0.5 * scene.stiffness[self.axis])

    def law(self) -> Law:
        """Return the torque of the relaxing spring."""
        return Law(laws.CREEP, self.axis, (self.size, self.time_s))

    def truth(self) -> dict[str, float]:
        """Return both parameters."""
        return {"stiffness": self.size, "time_constant_s": self.time_s}


@dataclass(frozen=True)
class EndStop(Hidden):
    """A lossy stop within the travel."""

    gap: float
    loss_s: float

    slug: ClassVar[str] = "end-stop-contact"
    one_sided: ClassVar[bool] = True

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a gap of 60–92 % of the largest deflection."""
        a = some_axis(rng, scene)
        gap = rng.uniform(0.6, 0.92) * float(scene.y_peak[a])
        loss = rng.uniform(0.0, 0.3) / float(scene.rate_peak[a])
        return cls(a, float(0.3 * scene.stiffness[a]), gap, loss)

    def cap(self, scene: Scene) -> float:
        """Twenty times the suspension's stiffness."""
        return float(20.0 * scene.stiffness[self.axis])

    def law(self) -> Law:
        """Return the torque of the stop, its damping in proportion to its stiffness."""
        return Law(laws.STOP, self.axis, (self.size, self.size * self.loss_s, self.gap))

    def truth(self) -> dict[str, float]:
        """Return stiffness and gap."""
        return {"stiffness": self.size, "gap": self.gap}


@dataclass(frozen=True)
class CrossCoupling(Coupled):
    """The drive of one axis pushes the other as well."""

    way: float

    slug: ClassVar[str] = "cross-coupling"

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a twentieth of the source's drive."""
        a = some_axis(rng, scene)
        return cls(a, 0.05, 1 - a, sign(rng))

    def cap(self, scene: Scene) -> float:
        """Half the source's drive."""
        return 0.5

    def on_command(self, drive: Array, excitation: Excitation) -> Array:
        """Return the drives with a share of the source's in the target's."""
        return on_axis(drive, self.axis, drive[:, self.axis] + self.size * self.way * drive[:, self.source])

    def truth(self) -> dict[str, float]:
        """Return the share."""
        return {"gain": self.size * self.way}


@dataclass(frozen=True)
class Play(Hidden):
    """A spring that is loose within its play."""

    gap: float

    slug: ClassVar[str] = "backlash"
    one_sided: ClassVar[bool] = True

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a play of 2–40 % of the rms deflection."""
        a = some_axis(rng, scene)
        return cls(a, float(0.1 * scene.stiffness[a]), log_uniform(rng, 0.02, 0.4) * float(scene.y_rms[a]))

    def cap(self, scene: Scene) -> float:
        """All of the stiffness: nothing holds the axis within the play."""
        return float(scene.stiffness[self.axis])

    def law(self) -> Law:
        """Return what the spring misses."""
        return Law(laws.PLAY, self.axis, (self.size, self.gap))

    def truth(self) -> dict[str, float]:
        """Return both parameters."""
        return {"stiffness": self.size, "gap": self.gap}


@dataclass(frozen=True)
class Cogging(Hidden):
    """A torque that is periodic in the position: size·sin(2π x / `period` + `phase`), `phase` in rad."""

    period: float
    phase: float

    slug: ClassVar[str] = "periodic-torque"

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a period of a tenth to four fifths of the largest deflection."""
        a = some_axis(rng, scene)
        period = log_uniform(rng, 0.1, 0.8) * float(scene.y_peak[a])
        return cls(a, float(0.02 * scene.stiffness[a] * period), period, rng.uniform(0.0, 2.0 * np.pi))

    def cap(self, scene: Scene) -> float:
        """Up to half the stiffness in its steepest part, so that the axis keeps one position of rest."""
        return float(0.5 * scene.stiffness[self.axis] * self.period / (2.0 * np.pi))

    def law(self) -> Law:
        """Return the torque over the position."""
        return Law(laws.COGGING, self.axis, (self.size, self.period, self.phase))

    def truth(self) -> dict[str, float]:
        """Return all parameters: size sin(2π x / period + phase) in cosine and sine."""
        return {
            "cosine": self.size * float(np.sin(self.phase)),
            "sine": self.size * float(np.cos(self.phase)),
            "period": self.period,
        }
