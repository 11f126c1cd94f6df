"""What a law is, and the decorators by which one function in `laws/` becomes one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sim_backend.jit import cfunc

Array = NDArray[np.float64]
Group = Literal["listed", "twisted", "unlisted"]
How = Literal["torque", "reading", "record", "delay"]

TORQUE = "void(float64, " + "float64[::1], " * 7 + "intp, intp)"
"""t, y, v, u, z, dz, p, f, i, j: adds to the torques `f` (axes,), and writes the rates `dz` of the law's states `z`."""

READING = "void(float64, " + "float64[::1], " * 6 + "intp, intp)"
"""t, y, v, u, z, p, r, i, j: changes the readings `r` (axes,) once a sample, and may change the states `z`."""


@dataclass(frozen=True)
class Scene:
    """What the undisturbed motion of one axis is like, from which sizes and shapes are drawn.

    Torques in the unit of the drive, positions in that of the sensor; `stiffness` is 0 for a rigid axis. The
    temperature is `kelvin` times a sine of `kelvin_hz` about 77 K.
    """

    y_rms: float
    y_peak: float
    v_rms: float
    v_peak: float
    u_rms: float
    u_peak: float
    stiffness: float
    frequency_hz: float
    inertia: float
    rate_hz: float
    run_s: float
    kelvin: float
    kelvin_hz: float

    @property
    def slope(self) -> float:
        """Torque per deflection that counts on this axis: its drive's over its motion."""
        return self.u_rms / self.y_rms


Shapes = Callable[[np.random.Generator, Scene], tuple[float, ...]]


@dataclass(frozen=True)
class Law:
    """One law of motion or of measurement.

    `effect` is what a diagnosis should call it: the listed name, or the law's own where none is listed. `size` is the
    size of a plain disturbance of a scene, `cap` the largest plausible size as a multiple of that. `shapes` follow the
    size in the parameters. `rate` (s⁻¹) is how fast a law reacts, which steps must resolve. `springy` laws need an axis
    with a stiffness; `axes` is how many they join, `most_axes` how many the bench may have; `alone` is false for those
    that have a twin on any bench.
    """

    name: str
    effect: str
    group: Group
    site: str
    how: How
    function: Any
    size: Callable[[Scene], float]
    shapes: Shapes
    states: int = 0
    axes: int = 1
    most_axes: int = 3
    springy: bool = False
    cap: float = 4.0
    parameter: str | None = None
    alone: bool = True
    rate: Callable[[Array, Scene], float] = lambda p, s: 0.0


LAWS: dict[str, Law] = {}
"""Every law by its name, filled by the decorator."""


def _bare(rng: np.random.Generator, scene: Scene) -> tuple[float, ...]:
    return ()


def law(
    name: str,
    group: Group,
    site: str,
    size: Callable[[Scene], float],
    *,
    how: How = "torque",
    effect: str | None = None,
    shapes: Shapes = _bare,
    **more: Any,
) -> Callable[[Callable[..., Any]], Law]:
    """Return a decorator that enters a function as a law; `more` are fields of Law."""
    signature = {"torque": TORQUE, "reading": READING}.get(how)

    def enter(function: Callable[..., Any]) -> Law:
        compiled = cfunc(signature, error_model="numpy")(function) if signature else function
        LAWS[name] = Law(name, effect or name, group, site, how, compiled, size, shapes, **more)
        return LAWS[name]

    return enter


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


@cfunc(TORQUE)
def no_torque(t, y, v, u, z, dz, p, f, i, j):  # type: ignore[no-untyped-def]
    """Add nothing."""


@cfunc(READING)
def no_reading(t, y, v, u, z, p, r, i, j):  # type: ignore[no-untyped-def]
    """Change nothing."""
