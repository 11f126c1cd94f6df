"""What a bench is: a Protocol that plays segments and returns records; simulated, emulated and real benches alike.

A segment is data: what is played, how the loops are closed, what is recorded. So a plan can be checked against a
bench's limits, counted and shown without moving anything, and can be sent over a serial line.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from sim_backend.control.blocks import DiscreteFilter
from sim_backend.errors import ConfigError

Array = NDArray[np.float64]
Role = Literal["input", "output", "reference", "aux"]

MAX_TAPS = 511
"""Longest Q filter; the learning memory is this much longer than the period whatever the filter, so that it survives
a change."""


@dataclass(frozen=True)
class Signal:
    """One recorded channel: name, unit (SI), role in the experiment and degree of freedom."""

    name: str
    unit: str
    role: Role
    dof: str
    sample_rate_hz: float
    t0_s: float = 0.0


@dataclass(frozen=True)
class Coil:
    """The coil of an actuator: force per ampere, force per root of watt, and the force that it may give for good."""

    force_constant_n_a: float
    steepness_n_sqrt_w: float
    continuous_force_n: float


@dataclass(frozen=True)
class Limits:
    """What a bench may be asked: per axis `reference` (largest magnitude, output unit), and `current_a` per actuator.

    `to_current` (n_a, n_u) turns commands into currents. Shapes: `reference` (n_axes,). `coil` is None where the bench
    does not say what its coils stand.
    """

    reference: Array
    current_a: float
    to_current: Array
    coil: Coil | None = None


UNNAMED = "simulated"
"""The name of a bench that is simulated within something else, and not opened by an address."""

SIMULATED = ("sim", "emulator")
"""The kinds of bench that are simulated: their serial number is the seed."""


@dataclass(frozen=True)
class Identity:
    """What a bench says of itself; goes into every log and onto every figure. Never holds simulated parameters."""

    kind: str
    name: str
    serial: str
    version: str


@dataclass(frozen=True)
class Gate:
    """Close (or open) the feedback of one axis at a sample of the period; the integrator starts from `integrator`."""

    at_sample: int
    axis: int
    closed: bool
    integrator: float = 0.0


@dataclass(frozen=True)
class Learning:
    """Repetitive control of one axis, u_k = Q (u_{k-N} + gain · L e_{k-N+lead}); see (6.4) of the paper.

    `taps` is the symmetric Q filter of odd length (one tap of 1: no filter); with `active` False the last learned
    period repeats.
    """

    filter: DiscreteFilter
    gain: float
    lead: int
    period: int
    taps: tuple[float, ...] = (1.0,)
    active: bool = True

    def __post_init__(self) -> None:
        if len(self.taps) % 2 == 0 or not np.allclose(self.taps, self.taps[::-1], rtol=1e-12, atol=0.0):
            raise ConfigError(
                f"learning: the Q filter has {len(self.taps)} taps; it needs an odd number, symmetric, for zero phase"
            )
        if len(self.taps) > MAX_TAPS:
            raise ConfigError(
                f"learning: the Q filter has {len(self.taps)} taps, the limit is {MAX_TAPS}; raise its cut-off"
            )
        if not 0 <= self.lead + len(self.taps) // 2 < self.period:
            raise ConfigError(
                f"learning: lead {self.lead} with {len(self.taps)} taps does not fit into a period of {self.period} "
                f"samples"
            )


@dataclass(frozen=True)
class Segment:
    """One stretch of an experiment: a period of waveforms, repeated until `n_samples` have been played.

    `reference` and `feedforward` are (period, n_axes) in output and input units. `feedback` and `learning` hold one
    entry per axis, None for none; `gates` act within every period. A feedback that is closed when a segment ends
    stays closed in the next. `cold_finger_k` changes the set temperature; the segment begins once the bench has
    settled there. `record` names the channels to keep, empty for all. `settings` go into the log's segment table.
    """

    label: str
    n_samples: int
    reference: Array
    feedforward: Array
    feedback: tuple[DiscreteFilter | None, ...] = ()
    gates: tuple[Gate, ...] = ()
    learning: tuple[Learning | None, ...] = ()
    cold_finger_k: float | None = None
    record: tuple[str, ...] = ()
    settings: dict[str, float | str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.n_samples <= 0:
            raise ConfigError(f"segment '{self.label}': {self.n_samples} samples; it needs at least one")
        if self.reference.ndim != 2 or self.reference.shape != self.feedforward.shape or not self.reference.size:
            raise ConfigError(
                f"segment '{self.label}': reference {self.reference.shape} and feed-forward {self.feedforward.shape} "
                "must have the same shape (period, axes)"
            )
        for name in ("reference", "feedforward"):
            if not np.all(np.isfinite(getattr(self, name))):
                raise ConfigError(
                    f"segment '{self.label}': the {name} holds a number that is not finite; mend the waveform"
                )
        for gate in self.gates:
            if not 0 <= gate.at_sample < self.reference.shape[0]:
                raise ConfigError(
                    f"segment '{self.label}': a gate at sample {gate.at_sample} lies outside the period of "
                    f"{self.reference.shape[0]}"
                )


@dataclass(frozen=True)
class Record:
    """What a bench measured during one segment: channels by name, each (n_samples,)."""

    segment: Segment
    channels: dict[str, Array]


class Bench(Protocol):
    """A tip/tilt bench, or any other with the same few verbs."""

    @property
    def identity(self) -> Identity:
        """Who it is."""

    @property
    def signals(self) -> tuple[Signal, ...]:
        """Every channel that it can record."""

    @property
    def axes(self) -> tuple[str, ...]:
        """The degrees of freedom, in the order of all waveforms."""

    @property
    def limits(self) -> Limits:
        """What it may be asked."""

    def play(self, segment: Segment) -> Record:
        """Play one segment from the present state; raises HardwareError when it cannot."""

    def safe(self) -> None:
        """Zero all drives and open all loops; never raises."""

    def close(self) -> None:
        """Leave the bench safe and let it go."""


@dataclass(frozen=True)
class Demand:
    """The most that a segment's waveforms ask for: `reference` (n_axes,) in magnitude, and `current_a` of an actuator.

    What a feedback or learning adds depends on the bench.
    """

    reference: Array
    current_a: float


def check_segment(segment: Segment, limits: Limits) -> Demand:
    """Return what a segment asks for; raise ConfigError for a reference or a current beyond the bench's limits."""
    if segment.reference.shape[1] != limits.reference.size:
        raise ConfigError(
            f"segment '{segment.label}': waveforms have {segment.reference.shape[1]} axes, the bench has "
            f"{limits.reference.size}"
        )
    # axis by axis: numpy takes sixty times as long for all columns at once
    reach = np.array([np.max(np.abs(column)) for column in segment.reference.T])
    over = np.flatnonzero(reach > limits.reference)
    if over.size:
        i = int(over[0])
        raise ConfigError(
            f"segment '{segment.label}': reference of axis {i + 1} reaches {reach[i]:.4g} (rad, m), the end stop is at "
            f"{limits.reference[i]:.4g}; stay below it"
        )
    current_a = float(np.max(np.abs(segment.feedforward @ limits.to_current.T), initial=0.0))
    if current_a > limits.current_a:
        raise ConfigError(
            f"segment '{segment.label}': feed-forward asks for {current_a:.3g} A, an amplifier gives "
            f"{limits.current_a:.3g} A; "
            "make the step smaller or slower"
        )
    return Demand(reach, current_a)
