"""Hidden effects of the sensors: what the readings make of the motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from analysis.challenge.families.base import Coupled, Hidden, Scene, log_uniform, on_axis, sign, some_axis
from analysis.challenge.motion import Excitation, Motion
from sim_backend.jit import njit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SensorGain(Hidden):
    """The reading is too large or too small."""

    way: float

    slug: ClassVar[str] = "sensor-gain"

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a tenth."""
        return cls(some_axis(rng, scene), 0.1, sign(rng))

    def cap(self, scene: Scene) -> float:
        """Up to 60 %."""
        return 0.6

    def on_reading(self, reading: Array, motion: Motion, excitation: Excitation, rng: np.random.Generator) -> Array:
        """Return the reading at another gain."""
        return on_axis(reading, self.axis, reading[:, self.axis] * (1.0 + self.size * self.way))

    def truth(self) -> dict[str, float]:
        """Return the relative error."""
        return {"relative": self.size * self.way}


@dataclass(frozen=True)
class SensorRotation(Coupled):
    """The reading of one axis sees the motion of the other."""

    way: float

    slug: ClassVar[str] = "sensor-rotation"

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw an angle of 0.05 rad."""
        a = some_axis(rng, scene)
        return cls(a, 0.05, 1 - a, sign(rng))

    def cap(self, scene: Scene) -> float:
        """Up to 0.5 rad."""
        return 0.5

    def on_reading(self, reading: Array, motion: Motion, excitation: Excitation, rng: np.random.Generator) -> Array:
        """Return the reading with a share of the source's motion."""
        seen = motion.sampled()[:, self.source]
        return on_axis(reading, self.axis, reading[:, self.axis] + self.size * self.way * seen)

    def truth(self) -> dict[str, float]:
        """Return the angle."""
        return {"angle": self.size * self.way}


@dataclass(frozen=True)
class PeriodicError(Hidden):
    """The interferometer's error that repeats over the position."""

    period: float
    phase: float

    slug: ClassVar[str] = "periodic-sensor-error"

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a period of a 50th to four fifths of the largest deflection."""
        a = some_axis(rng, scene)
        period = log_uniform(rng, 0.02, 0.8) * float(scene.y_peak[a])
        return cls(a, 0.02 * period, period, rng.uniform(0.0, 2.0 * np.pi))

    def cap(self, scene: Scene) -> float:
        """Up to where the reading's slope would lose half."""
        return 0.5 * self.period / (2.0 * np.pi)

    def on_reading(self, reading: Array, motion: Motion, excitation: Excitation, rng: np.random.Generator) -> Array:
        """Return the reading with its error."""
        x = motion.sampled()[:, self.axis]
        error = self.size * np.sin(2.0 * np.pi * x / self.period + self.phase)
        return on_axis(reading, self.axis, reading[:, self.axis] + error)

    def truth(self) -> dict[str, float]:
        """Return all parameters: size sin(2π x / period + phase) in cosine and sine."""
        return {
            "cosine": self.size * float(np.sin(self.phase)),
            "sine": self.size * float(np.cos(self.phase)),
            "period": self.period,
        }


@dataclass(frozen=True)
class SensorQuantisation(Hidden):
    """The noisy reading is recorded in whole steps of `size`."""

    slug: ClassVar[str] = "sensor-quantisation"
    one_sided: ClassVar[bool] = True
    proportional: ClassVar[bool] = False
    predictable: ClassVar[bool] = False
    smooth: ClassVar[bool] = False

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw the noise's standard deviation."""
        a = some_axis(rng, scene)
        return cls(a, float(scene.noise_std[a]))

    def cap(self, scene: Scene) -> float:
        """Up to a quarter of the rms motion."""
        return float(0.25 * scene.y_rms[self.axis])

    def on_record(self, reading: Array, rng: np.random.Generator) -> Array:
        """Return the reading (n, n_y) with this axis rounded to whole steps."""
        return on_axis(reading, self.axis, self.size * np.rint(reading[:, self.axis] / self.size))

    def truth(self) -> dict[str, float]:
        """Return the step."""
        return {"step_size": self.size}


@njit
def _miscounts(rate, limit):  # type: ignore[no-untyped-def]
    """Return the fringes lost until each fine step: one per excursion beyond the limit, which ends at half of it."""
    count = np.zeros(rate.size)
    lost, away = 0.0, False
    for k in range(rate.size):
        speed = abs(rate[k])
        if not away and speed > limit:
            lost -= np.sign(rate[k])
            away = True
        elif speed < 0.5 * limit:
            away = False
        count[k] = lost
    return count


@dataclass(frozen=True)
class FringeJump(Hidden):
    """A counter of fringes loses one of `size` whenever the motion is too fast for it; the offset stays."""

    limit: float

    slug: ClassVar[str] = "fringe-jump"

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a limit of 50–90 % of the fastest motion."""
        a = some_axis(rng, scene)
        return cls(a, float(0.01 * scene.y_rms[a]), rng.uniform(0.5, 0.9) * float(scene.rate_peak[a]))

    def cap(self, scene: Scene) -> float:
        """Up to the rms motion."""
        return float(scene.y_rms[self.axis])

    def on_reading(self, reading: Array, motion: Motion, excitation: Excitation, rng: np.random.Generator) -> Array:
        """Return the reading with the fringes it lost."""
        lost = _miscounts(np.ascontiguousarray(motion.rate[:, self.axis]), self.limit)[:: motion.substeps]
        return on_axis(reading, self.axis, reading[:, self.axis] + self.size * lost)

    def truth(self) -> dict[str, float]:
        """Return the fringe."""
        return {"fringe": self.size}


@dataclass(frozen=True)
class ApexNoise(Hidden):
    """White noise that grows with the distance from the centre, by `size` per distance."""

    slug: ClassVar[str] = "apex-noise"
    predictable: ClassVar[bool] = False
    random: ClassVar[bool] = True

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw as much as the other noise at the rms distance."""
        a = some_axis(rng, scene)
        return cls(a, float(scene.noise_std[a] / scene.y_rms[a]))

    def cap(self, scene: Scene) -> float:
        """Up to a tenth of the motion."""
        return 0.1

    def deviation(self, position: Array) -> Array:
        """Return the standard deviation (n,) of the added noise, in rad, at positions (n,)."""
        return self.size * np.abs(position)

    def on_reading(self, reading: Array, motion: Motion, excitation: Excitation, rng: np.random.Generator) -> Array:
        """Return the reading with the added noise."""
        deviation = self.deviation(motion.sampled()[:, self.axis])
        return on_axis(reading, self.axis, reading[:, self.axis] + deviation * rng.standard_normal(deviation.size))

    def truth(self) -> dict[str, float]:
        """Return the growth."""
        return {"linear": self.size}


@dataclass(frozen=True)
class SensorDrift(Hidden):
    """The zero of the reading moves by `size` per second from the start of each run."""

    way: float

    slug: ClassVar[str] = "sensor-drift"

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Draw a hundredth of the rms motion over a run."""
        a = some_axis(rng, scene)
        return cls(a, float(0.01 * scene.y_rms[a] / scene.run_s), sign(rng))

    def cap(self, scene: Scene) -> float:
        """Up to the rms motion over a run."""
        return float(scene.y_rms[self.axis] / scene.run_s)

    def on_reading(self, reading: Array, motion: Motion, excitation: Excitation, rng: np.random.Generator) -> Array:
        """Return the reading with its moving zero."""
        time_s = np.arange(reading.shape[0]) / excitation.rate_hz
        return on_axis(reading, self.axis, reading[:, self.axis] + self.size * self.way * time_s)

    def truth(self) -> dict[str, float]:
        """Return the drift."""
        return {"drift": self.size * self.way}
