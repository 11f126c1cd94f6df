"""What a bench says of itself over the line: one JSON document, fixed in its firmware."""

from __future__ import annotations

import msgspec
import numpy as np

from campaigns.names import check_label, check_name
from sim_backend.bench import Bench, Coil, Limits, Role, Signal
from sim_backend.errors import ConfigError, HardwareError

SCHEMA = "mccd-bench/1"
_RATES_HZ = (1e-3, 1e6)


class Channel(msgspec.Struct, frozen=True, kw_only=True):
    """One channel; `by_default` channels are recorded when a segment names none."""

    name: str
    unit: str
    role: Role
    dof: str
    t0_s: float = 0.0
    by_default: bool = True


class Description(msgspec.Struct, frozen=True, kw_only=True):
    """Everything fixed about a bench; a limit of null is none.

    `reference` is one number per axis (rad or m), `to_current` (n_actuators, n_axes) in A per input unit. The
    interlocks: `travel` per axis in output units, `trip_current_a` per actuator. `memory_bytes` bounds a record. `coil`
    is null where the firmware does not know what the coils stand.
    """

    schema: str
    axes: tuple[str, ...]
    rate_hz: float
    channels: tuple[Channel, ...]
    reference: tuple[float | None, ...]
    current_a: float | None
    to_current: tuple[tuple[float, ...], ...]
    travel: tuple[float | None, ...]
    trip_current_a: float | None
    memory_bytes: int
    coil: Coil | None = None

    @property
    def signals(self) -> tuple[Signal, ...]:
        """The channels as signals of a bench."""
        return tuple(Signal(c.name, c.unit, c.role, c.dof, self.rate_hz, c.t0_s) for c in self.channels)

    @property
    def limits(self) -> Limits:
        """The limits as those of a bench."""
        reference = np.array([np.inf if r is None else r for r in self.reference])
        current_a = np.inf if self.current_a is None else self.current_a
        return Limits(reference, current_a, np.array(self.to_current).reshape(-1, len(self.axes)), self.coil)

    @property
    def channel_names(self) -> tuple[str, ...]:
        """All channels in the bench's order."""
        return tuple(c.name for c in self.channels)

    @property
    def default_names(self) -> tuple[str, ...]:
        """The channels that are recorded when a segment names none."""
        return tuple(c.name for c in self.channels if c.by_default)


def describe(bench: Bench, *, travel_factor: float, current_factor: float, memory_bytes: int) -> Description:
    """Return the description of `bench`, its interlocks at these multiples of its limits.

    Of all instruments only a theodolite stands beside the bench: it is recorded when it is asked for.
    """
    limits = bench.limits
    return Description(
        schema=SCHEMA,
        axes=bench.axes,
        rate_hz=bench.signals[0].sample_rate_hz,
        channels=tuple(
            Channel(
                name=s.name,
                unit=s.unit,
                role=s.role,
                dof=s.dof,
                t0_s=s.t0_s,
                by_default=not s.name.startswith("theodolite_"),
            )
            for s in bench.signals
        ),
        reference=tuple(_finite(value) for value in limits.reference),
        current_a=_finite(limits.current_a),
        to_current=tuple(tuple(float(v) for v in row) for row in limits.to_current),
        travel=tuple(_finite(value * travel_factor) for value in limits.reference),
        trip_current_a=_finite(limits.current_a * current_factor),
        memory_bytes=memory_bytes,
        coil=limits.coil,
    )


def encode_description(description: Description) -> bytes:
    """Return the JSON document; every number keeps all its digits."""
    return msgspec.json.encode(description)


def decode_description(text: bytes) -> Description:
    """Return the description in a JSON document; raises HardwareError when it is none, or contradicts itself."""
    try:
        found = msgspec.json.decode(text, type=Description)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise HardwareError(f"the bench's description cannot be read ({error}); update its firmware") from None
    if wrong := _wrong(found):
        raise HardwareError(f"the bench's description cannot be right: {wrong}; update its firmware")
    return found


def _wrong(found: Description) -> str:
    """Return what contradicts itself or cannot be, empty for a description that can."""
    n, names, roles = len(found.axes), found.channel_names, {c.role for c in found.channels}
    limits = [r for r in (*found.reference, *found.travel, found.current_a, found.trip_current_a) if r is not None]
    coil = found.coil
    fits = len(found.reference) == n == len(found.travel) and all(len(row) == n for row in found.to_current)
    doubts = {
        f"its schema is '{found.schema[:40]}', not {SCHEMA}": found.schema != SCHEMA,
        f"{n} axes, some of them of one name": not n or len(set(found.axes)) < n,
        f"not every list of limits is for {n} axes": not fits,
        f"{len(names)} channels, some of them of one name": len(set(names)) < len(names),
        "it lacks a channel of role input or output": not {"input", "output"} <= roles,
        f"a rate of {found.rate_hz:g} Hz; {_RATES_HZ[0]:g} to {_RATES_HZ[1]:g} is possible": not _RATES_HZ[0]
        <= found.rate_hz
        <= _RATES_HZ[1],
        "a limit below zero": any(limit < 0.0 for limit in limits),
        "a coil with a number that is not above zero": coil is not None and min(vars(coil).values()) <= 0.0,
        f"it trips at {found.trip_current_a} A, below its limit of {found.current_a} A": _reversed(
            found.current_a, found.trip_current_a
        ),
        "an axis trips within its largest reference": any(map(_reversed, found.reference, found.travel)),
        f"{found.memory_bytes} bytes of memory": found.memory_bytes <= 0,
    }
    return next((doubt for doubt, holds in doubts.items() if holds), "") or _misnamed(found)


def _reversed(limit: float | None, trip: float | None) -> bool:
    """Tell whether an interlock would trip within what a bench may be asked; null means no limit."""
    return limit is not None and trip is not None and trip < limit


def _misnamed(found: Description) -> str:
    try:
        for axis in found.axes:
            check_name(axis, "axis")
        for channel in found.channels:
            check_name(channel.name, "channel")
            check_label(channel.unit or "1", "unit")
            check_label(channel.dof or "none", "degree of freedom")
    except ConfigError as error:
        return str(error)
    return ""


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
