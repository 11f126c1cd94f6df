"""What an effect is: one object that simulation, screening, fitting, naming and the report all read.

An effect says what it is (name, family, symptom), where in the loop it acts (`site`), what its parameters are, and how
it is simulated: `step`, a compiled function called once per sample with the signals at its location, returning what it
*adds* there. A contribution that is added, never a value that replaces, makes two promises easy to keep: neutral
parameters add nothing, so they give exactly the model without the effect; and running the same compiled step along a
measured trajectory gives the effect's first-order signature, so that screening needs no second definition of the
physics.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import IntEnum
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar, Self, cast

import numpy as np
from numpy.typing import NDArray

from sim_backend.errors import ConfigError
from sim_backend.noise import standard_normal

if TYPE_CHECKING:
    from sim_backend.effects.view import RecordView
    from sim_backend.linear import ModalModel

Array = NDArray[np.float64]


UNLISTED = ""
"""What is not in the library: beyond the limit of its shape an effect may be that, and has no name."""

UNKNOWN_RUN = -1
"""Number of a run that no fit has seen."""


class Site(IntEnum):
    """Where in the loop an effect adds its contribution; the order is that of the signal path."""

    COMMAND = 0  # the command of one input, before the amplifier
    CURRENT = 1  # the current of one actuator
    DRIVE = 2  # the torque of one input, between actuator and structure; may depend on position
    STRUCTURE = 3  # a torque on one coordinate that depends on its motion; extrapolated to mid-step by the kernel
    HEAD = 4  # the reading of one sensor head
    READING = 5  # the reading of one degree of freedom
    MODEL = 6  # not a signal: the effect changes the linear model itself (`retune`)
    RECORD = 7  # not a signal: the effect changes the finished record of a reading (`rewrite`), e.g. its clock


class Aux(IntEnum):
    """What a step receives as `aux`."""

    NONE = 0
    EXOGENOUS = 1  # normal numbers drawn beforehand, one per sample
    TEMPERATURE = 2  # the bench's temperature (K)
    SOURCE_COMMAND = 3  # the command of the effect's source channel (`where` is "source->target")
    SOURCE_POSITION = 4  # the position of the effect's source channel


@dataclass(frozen=True)
class Dimension:
    """Powers of the input unit, the output unit, the second and the kelvin in a parameter's unit.

    Units depend on the bench (N m and rad here, V and m on a piezo mirror), so a parameter states powers and gets
    both its unit and its natural size from the channels it is used with.
    """

    u: int = 0
    y: int = 0
    s: int = 0
    k: int = 0

    def unit(self, u: str, y: str) -> str:
        """Return the unit for input unit `u` and output unit `y`, e.g. 'N m/rad^3'; '1' when dimensionless."""
        powers: dict[str, int] = {}
        for name, power in ((u, self.u), (y, self.y), ("s", self.s), ("K", self.k)):
            powers[name] = powers.get(name, 0) + power
        parts = [(n, p) for n, p in powers.items() if n != "1"]
        above = [_power(name, p) for name, p in parts if p > 0]
        below = [_power(name, -p) for name, p in parts if p < 0]
        return "/".join([" ".join(above) or "1", *below])

    def scale(self, u: float, y: float, s: float, k: float = 1.0) -> float:
        """Return the natural size of the parameter where signals have sizes `u`, `y`, `s` and `k`."""
        return float(u**self.u * y**self.y * s**self.s * k**self.k)


def _power(name: str, p: int) -> str:
    base = f"({name})" if " " in name and p > 1 else name
    return base if p == 1 else f"{base}^{p}"


@dataclass(frozen=True)
class Parameter:
    """What is known of one parameter: its neutral value, dimension, bounds and whether it is a size or a shape.

    With all *sizes* neutral the effect adds nothing, and for fixed *shapes* the contribution is linear in the sizes. An
    effect without sizes is neutral at its shapes' neutral values (a limit at infinity, say). Bounds are absolute; `log`
    says that the parameter is searched on a logarithmic scale. A `fixed` parameter is a constant of the description
    that no data can distinguish from another parameter; a fit does not change it. `spread` is how far a shape may
    plausibly be from where `guess` searches for it, as a standard deviation of its logarithm. `grain` is by which part
    of itself a shape has to change for the contribution to change at all, where it does so in jumps.
    """

    name: str
    neutral: float
    dimension: Dimension
    low: float
    high: float
    size: bool
    log: bool
    fixed: bool
    spread: float
    grain: float
    about: str


def size(
    about: str,
    *,
    u: int = 0,
    y: int = 0,
    s: int = 0,
    k: int = 0,
    low: float = -math.inf,
    high: float = math.inf,
) -> Any:
    """Declare a size parameter (neutral 0, contribution linear in it) as a dataclass field."""
    return _declare(0.0, Dimension(u, y, s, k), low, high, size=True, about=about)


def shape(
    about: str,
    neutral: float,
    *,
    u: int = 0,
    y: int = 0,
    s: int = 0,
    k: int = 0,
    low: float = 0.0,
    high: float = math.inf,
    log: bool = True,
    spread: float = 2.0,
    grain: float = 0.0,
) -> Any:
    """Declare a shape parameter (the contribution depends on it nonlinearly) as a dataclass field."""
    return _declare(neutral, Dimension(u, y, s, k), low, high, log=log, spread=spread, grain=grain, about=about)


def constant(
    about: str,
    neutral: float,
    *,
    u: int = 0,
    y: int = 0,
    s: int = 0,
    k: int = 0,
    low: float = 0.0,
    high: float = math.inf,
) -> Any:
    """Declare a parameter that a model file states and no fit searches, as a dataclass field.

    It would be redundant: a reference temperature with the stiffness, say.
    """
    return _declare(neutral, Dimension(u, y, s, k), low, high, fixed=True, about=about)


def _declare(
    neutral: float,
    dim: Dimension,
    low: float,
    high: float,
    *,
    about: str,
    size: bool = False,
    log: bool = False,
    fixed: bool = False,
    spread: float = 0.0,
    grain: float = 0.0,
) -> Any:
    meta = {"dimension": dim, "low": low, "high": high, "size": size, "log": log, "fixed": fixed, "spread": spread}
    meta |= {"grain": grain, "about": about}
    return field(default=neutral, metadata=meta)


@dataclass(frozen=True)
class Effect:
    """One physical effect at one location, with its parameters as fields.

    Subclasses set `name`, `family`, `site`, `symptom` and, as they need, `exact`, `linear_form`, `several`, `beyond`,
    `aux`, `n_state`, `step`, `guess`, `limits`, `drawn_std`, `retune`, `rewrite`. Raises ConfigError when a parameter
    is not finite or outside its bounds.
    """

    where: str

    name: ClassVar[str]
    family: ClassVar[str]  # structure, drive, sensor or surroundings
    site: ClassVar[Site]
    cause: ClassVar[str] = ""  # the name it is reported by, where several models share one cause; else `name`
    symptom: ClassVar[str]  # what a person sees in the residual; ends the sentence "the residual …"
    several: ClassVar[bool] = (
        False  # one location may have several of it, distinguished by their shapes, as modes by frequency
    )
    aux: ClassVar[Aux] = Aux.NONE
    beyond: ClassVar[Mapping[str, str]] = {}  # by a shape, what it is called beyond the limit, or UNLISTED
    whole: ClassVar[bool] = False  # a small part of what it adds is not what it adds at any other shape
    n_state: ClassVar[int] = 0
    step: ClassVar[Any] = None  # compiled with @compiled
    exact: ClassVar[bool] = False  # no model discrepancy: a gain is a gain, a friction is only an approximate law
    linear_form: ClassVar[bool] = False  # its model discrepancy is linear and steady as well

    def __post_init__(self) -> None:
        for p in self.parameters():
            value = getattr(self, p.name)
            if p.low <= value <= p.high and math.isfinite(value):
                continue
            neutral_at_infinity = math.isinf(p.neutral) and value == p.neutral
            if not (neutral_at_infinity and p.low <= value <= p.high):
                raise ConfigError(
                    f"effect {self.name} at {self.where}: {p.name} is {value:g}; it must lie in [{p.low:g}, {p.high:g}]"
                )

    @classmethod
    def reported(cls) -> str:
        """Return the name of the physical cause: what a diagnosis says."""
        return cls.cause or cls.name

    @classmethod
    @cache
    def parameters(cls) -> tuple[Parameter, ...]:
        """Return what is known of each parameter, in the order in which `step` receives them."""
        return tuple(
            Parameter(name=f.name, neutral=cast(float, f.default), **f.metadata) for f in fields(cls) if f.metadata
        )

    @classmethod
    @cache
    def parameter_names(cls) -> frozenset[str]:
        """Return the names of all parameters."""
        return frozenset(p.name for p in cls.parameters())

    @classmethod
    def sizes(cls) -> tuple[str, ...]:
        """Return the names of the size parameters."""
        return tuple(p.name for p in cls.parameters() if p.size)

    @classmethod
    def shapes(cls) -> tuple[str, ...]:
        """Return the names of the shape parameters that a fit searches: constants are left out."""
        return tuple(p.name for p in cls.parameters() if not p.size and not p.fixed)

    def numbers(self) -> list[float]:
        """Return the parameter values in the order of `parameters`."""
        return [getattr(self, p.name) for p in self.parameters()]

    def values(self) -> Array:
        """Return the parameter values, shape (n_parameters,), in the order of `parameters`."""
        return np.array(self.numbers(), dtype=float)

    def is_neutral(self) -> bool:
        """Tell whether the effect adds nothing: all sizes zero or, without sizes, all shapes neutral."""
        watched = [p for p in self.parameters() if p.size] or list(self.parameters())
        return all(getattr(self, p.name) == p.neutral for p in watched)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return starts that span what `view` could show: values for the shapes, and for constants that follow from it.

        [{}] when there is nothing to choose; [] when the record cannot show the effect (it has no temperature, say).
        """
        return [{}]

    @classmethod
    def limits(cls, view: RecordView) -> dict[str, tuple[float, float]]:
        """Return the lowest and highest values of shapes between which `view` can show the effect for what it is.

        Beyond them it could stand for anything: what does not repeat within the motion is not periodic.
        """
        return {}

    @classmethod
    def given(cls, view: RecordView, shapes: dict[str, float]) -> dict[str, Any]:
        """Return fields that are no parameters and follow from `view` once the `shapes` are chosen, by name."""
        return {}

    @classmethod
    def choices(cls, view: RecordView) -> float:
        """Return among how many independent shapes `guess` chose by means of the residual; 1 when it did not use it.

        Noise alone is large somewhere among so many, and a screening has to allow for it.
        """
        return 1

    def in_run(self, run: int) -> Self:
        """Return the effect as it acts in the run with that number: what goes on by itself is elsewhere in each.

        In an UNKNOWN_RUN it acts as it would from the start.
        """
        return self

    def own_frequency_hz(self) -> float:
        """Return the frequency of what it does by itself, whatever is played and whenever a run begins; else 0."""
        return 0.0

    def turned(self, periods: float) -> Self:
        """Return the effect so many periods of its own frequency further on."""
        return self

    def braking(self) -> float:
        """Return by how much its torque against the motion rises with the rate near rest, in input units per rate."""
        return 0.0

    def chosen(self) -> int:
        """Return how many phases, which are no parameters, were chosen by looking at the data all the same."""
        return 0

    def start(self) -> Array:
        """Return the state before the first sample, shape (n_state,)."""
        return np.zeros(self.n_state)

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator, out: Array | None = None) -> Array:
        """Return the exogenous numbers of `n` samples, shape (n,): normal ones of standard deviation `drawn_std`.

        `out` (n,) is filled and returned where it is given. Raises ConfigError unless `aux` is EXOGENOUS.
        """
        if self.aux is not Aux.EXOGENOUS:
            raise ConfigError(f"effect {self.name} draws no exogenous numbers; its aux is {self.aux.name}")
        out = standard_normal(n, rng, out)
        out *= self.drawn_std(rate_hz)
        return out

    def drawn_std(self, rate_hz: float) -> float:
        """Return the standard deviation of the numbers that are drawn, one per sample at `rate_hz`."""
        return 1.0

    def retune(self, model: ModalModel, input_index: int, output_index: int) -> ModalModel:
        """Return the linear model with this effect in it, for effects whose site is MODEL."""
        raise ConfigError(f"effect {self.name} does not change the linear model; it acts on {self.site.name}")

    def rewrite(self, values: Array, rate_hz: float, rng: np.random.Generator | None = None) -> Array:
        """Return the reading at `where`, shape (n,), as recorded with this effect, for effects whose site is RECORD.

        Without `rng` nothing random happens.
        """
        raise ConfigError(f"effect {self.name} does not change the record; it acts on {self.site.name}")
