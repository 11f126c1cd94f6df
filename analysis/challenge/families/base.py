"""What a hidden effect is: drawn from a scene, scaled by one size, and applied by formulas of its own."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from analysis.challenge.motion import Excitation, Motion
from analysis.challenge.plant import AXES, Plant

Array = NDArray[np.float64]


class Law(NamedTuple):
    """A torque that depends on the motion of one axis: its code in `laws.py`, the axis, and its parameters."""

    code: int
    axis: int
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class Scene:
    """What the scale of an effect may be drawn from: the undisturbed motion of the whole campaign without effects.

    Per axis (n,): peaks and rms values of command, position and rate over all runs, and `stiffness`; `run_s` is the
    longest run, `kelvin` the change of temperature, `places` are the axes to choose from; the others are numbers.
    """

    u_peak: Array
    u_rms: Array
    y_peak: Array
    y_rms: Array
    rate_peak: Array
    rate_rms: Array
    stiffness: Array
    plant: Plant
    noise_std: Array
    rate_hz: float
    run_s: float
    kelvin: float
    places: tuple[int, ...]

    def at(self, axis: int) -> Scene:
        """Return the scene in which effects are drawn on one axis only."""
        return replace(self, places=(axis,))

    @property
    def n_axes(self) -> int:
        """Number of axes."""
        return int(self.u_peak.size)


@dataclass(frozen=True)
class Hidden:
    """One effect at one location; `size` is what the detection and naming limits are stated in.

    Subclasses set `slug` (the library's name of the cause) and override the hooks they need.
    """

    axis: int
    size: float

    slug: ClassVar[str]
    needs_axes: ClassVar[int] = 1
    random: ClassVar[bool] = False  # known only by its statistics: detected by power, see `power.py`
    proportional: ClassVar[bool] = True  # its signature has one shape at any size
    one_sided: ClassVar[bool] = False  # its size has one sign by nature
    smooth: ClassVar[bool] = True  # the reading can be differentiated by the parameters
    predictable: ClassVar[bool] = True  # knowing it tells the next reading; chance and rounding do not
    given: ClassVar[tuple[str, ...]] = ("way",)  # fields that no data need to determine

    @classmethod
    def draw(cls, rng: np.random.Generator, scene: Scene) -> Self:
        """Return the effect at a random location with random shape, of about a tenth of the motion in size."""
        raise NotImplementedError

    def cap(self, scene: Scene) -> float:
        """Return the largest size at which it is still the effect of its name, on a bench that still works."""
        raise NotImplementedError

    @property
    def where(self) -> str:
        """The location as the library writes it."""
        return AXES[self.axis]

    def resized(self, size: float) -> Self:
        """Return the same effect at another size."""
        return replace(self, size=size)

    def truth(self) -> dict[str, float]:
        """Return the parameters that a diagnosis can be compared in, by the library's names."""
        return {}

    def free(self) -> tuple[str, ...]:
        """Return the fields that data have to tell: all numbers but the `given` ones."""
        return tuple(f.name for f in fields(self) if f.type == "float" and f.name not in self.given)

    def shapes(self) -> tuple[str, ...]:
        """Return the free fields apart from the size."""
        return tuple(name for name in self.free() if name != "size")

    def borrowing(self, other: Hidden, turn: float = 0.0) -> Self:
        """Return this effect with every shape that `other` has too, a phase shifted by `turn`: its closest relative."""
        shared = {name: getattr(other, name) for name in set(self.shapes()) & set(other.shapes())}
        if "phase" in shared:
            shared["phase"] += turn
        return replace(self, **shared)

    def on_plant(self, plant: Plant) -> Plant:
        """Return the plant with this effect in it."""
        return plant

    def on_command(self, drive: Array, excitation: Excitation) -> Array:
        """Return what the amplifiers give for commands `drive` on the fine grid, (n · substeps, axes)."""
        return drive

    def on_torque(self, drive: Array, excitation: Excitation, rng: np.random.Generator) -> Array:
        """Return the torques on the structure with what comes from outside, same shape."""
        return drive

    def law(self) -> Law | None:
        """Return the law of a torque that depends on the motion, None when there is none."""
        return None

    def on_reading(self, reading: Array, motion: Motion, excitation: Excitation, rng: np.random.Generator) -> Array:
        """Return what the sensor makes of the motion, (n, axes), before its noise."""
        return reading

    def on_record(self, reading: Array, rng: np.random.Generator) -> Array:
        """Return what is recorded of the noisy readings, (n, axes)."""
        return reading


@dataclass(frozen=True)
class Coupled(Hidden):
    """An effect that leads from the axis `source` to `axis`."""

    source: int

    needs_axes: ClassVar[int] = 2

    @property
    def where(self) -> str:
        """The location as the library writes it."""
        return f"{AXES[self.source]}->{AXES[self.axis]}"


def some_axis(rng: np.random.Generator, scene: Scene) -> int:
    """Return a random axis."""
    return int(rng.choice(scene.places))


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform between those of `low` and `high`."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def sign(rng: np.random.Generator) -> float:
    """Return 1 or -1."""
    return float(rng.choice([-1.0, 1.0]))


def on_axis(values: Array, axis: int, column: Array) -> Array:
    """Return a copy of `values` (n, axes) with one column replaced."""
    out = values.copy()
    out[:, axis] = column
    return out
