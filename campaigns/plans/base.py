"""What a plan is: a test as settings, which become segments without anything being moved.

A plan is a frozen struct whose fields are its settings in SI, with the unit in the name; unknown fields are errors.
From the bench it uses the public interface alone (axes, channels, rate, limits), so that it can be counted, checked
against limits and shown before the first sample is played, and runs unchanged on every bench.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from campaigns.sizes import BYTES_PER_VALUE, MOST_IN_WAVEFORM, require_at_once, require_run, samples_of
from sim_backend.bench import Bench, Demand, Segment, check_segment
from sim_backend.errors import ConfigError, did_you_mean
from sim_backend.model import dump_model, load_model

if TYPE_CHECKING:
    from campaigns.strategies.watch import Watch

Array = NDArray[np.float64]

SEGMENT_S = 10.0
"""Longest segment that plans make of steady motion: the most that an interrupt waits for and a crash can lose."""


@dataclass(frozen=True)
class Reach:
    """How far a plan may go on a bench: the `axes` to move, and the largest `command` of each axis of the bench.

    `command` has the shape (n_axes,), in input units; zero for an axis that must not move.
    """

    axes: tuple[str, ...]
    command: Array

    def scaled(self, level: float) -> Reach:
        """Return the same axes with `level` times the command, in two digits, as a person would set it."""
        return Reach(self.axes, np.array([rounded(level * c) for c in self.command]))

    def sizes(self, bench: Bench) -> dict[str, float]:
        """Return the largest command on an angle as `torque`, the smallest among the axes, and that on z as `force`.

        An axis kind that is not to move is left out.
        """
        own = {axis: float(self.command[axis_of(bench, axis)]) for axis in self.axes}
        angles = [size for axis, size in own.items() if axis != "z"]
        return ({"torque": min(angles)} if angles else {}) | ({"force": own["z"]} if "z" in own else {})


class Plan(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of all plans; a subclass adds its settings, its `name`, its `title` and `segments`."""

    name: ClassVar[str]
    title: ClassVar[str]

    def segments(self, bench: Bench) -> Iterator[Segment]:
        """Yield what is to be played on `bench`, in order; raises ConfigError for what the bench cannot be asked."""
        raise NotImplementedError

    def channels(self, bench: Bench) -> tuple[str, ...]:
        """Return the names of the channels to record, the same for every segment: commands, readings, temperature."""
        return channels_of(bench, ("input", "output"), ("temperature",))

    def watch(self, bench: Bench) -> Watch | None:
        """Return what judges a run on `bench` while it is played; None where limits checked before are enough."""
        return None

    def design_models(self) -> tuple[str, ...]:
        """Return the design models (names or paths) that the segments depend on besides the settings."""
        return ()

    def settings(self) -> dict[str, Any]:
        """Return all settings as plain values, defaults included."""
        plain: dict[str, Any] = msgspec.to_builtins(self)
        return plain

    def configuration(self) -> dict[str, Any]:
        """Return what decides the segments: plan, settings, and the text of every design model."""
        models = {name: dump_model(load_model(name)) for name in self.design_models()}
        return {"plan": self.name, "settings": self.settings(), "design_models": models}

    @classmethod
    def offers(cls, bench: Bench, reach: Reach) -> Iterator[Self]:
        """Yield the variants of this plan that could be the next experiment, none using more of the bench than `reach`.

        The same variants in the same order for any size of `reach`; a plan that is not an experiment of its own yields
        none.
        """
        yield from ()

    def changes(self) -> dict[str, Any]:
        """Return the settings that differ from the plan's defaults, as plain values."""
        usual, own = (msgspec.json.decode(msgspec.json.encode(plan)) for plan in (type(self)(), self))
        return {name: value for name, value in own.items() if value != usual[name]}

    @classmethod
    def of(cls, settings: dict[str, Any]) -> Self:
        """Return the plan with these settings; raises ConfigError naming a wrong or unknown one."""
        try:
            return msgspec.convert(settings, cls)
        except msgspec.ValidationError as error:
            known = ", ".join(cls.__struct_fields__)
            # the settings' names are the fields, and msgspec names one that is unknown in backticks
            unknown = str(error).partition("unknown field `")[2].partition("`")[0]
            near = did_you_mean(unknown, cls.__struct_fields__)
            raise ConfigError(f"plan {cls.name}: {error}; {near}its settings are {known}") from None

    def require(self, holds: bool, setting: str, needs: str) -> None:
        """Raise ConfigError unless `holds`: the setting, its value, and what it needs."""
        if not holds:
            raise ConfigError(f"plan {self.name}: {setting} is {getattr(self, setting)}; it must be {needs}")

    def require_run(self, bench: Bench, samples: float, segments: float) -> None:
        """Raise ConfigError for settings that make a run of this size, known before it is counted, too long."""
        require_run(f"plan {self.name}", samples, segments, len(self.channels(bench)), rate_of(bench))

    def require_positive(self, *names: str) -> None:
        """Raise ConfigError unless each of these settings is a finite number above zero."""
        for name in names:
            value = getattr(self, name)
            self.require(math.isfinite(value) and value > 0, name, "a finite number above zero")


@dataclass(frozen=True)
class Estimate:
    """What playing a plan will take, counted without playing it.

    `peak_current_a` and `peak_reference` (one per axis, output units) are those of the waveforms: what a feedback
    or learning adds depends on the bench.
    """

    plan: str
    segments: int
    samples: int
    channels: int
    duration_s: float
    bytes: int
    peak_current_a: float
    limit_current_a: float
    peak_reference: dict[str, float]
    limit_reference: dict[str, float]


def rounded(value: float) -> float:
    """Return `value` in two digits."""
    return float(f"{value:.2g}")


def rate_of(bench: Bench) -> float:
    """Return the sample rate in Hz that all channels of a bench share."""
    return bench.signals[0].sample_rate_hz


def channels_of(bench: Bench, roles: Iterable[str], aux: Iterable[str] = ()) -> tuple[str, ...]:
    """Return the channels with one of `roles`, and the auxiliary ones whose name begins with one of `aux`."""
    wanted, prefixes = set(roles), tuple(aux)
    return tuple(
        s.name
        for s in bench.signals
        if s.role in wanted or (s.role == "aux" and prefixes and s.name.startswith(prefixes))
    )


def axis_of(bench: Bench, axis: str) -> int:
    """Return the index of an axis; raises ConfigError naming those there are."""
    if axis not in bench.axes:
        raise ConfigError(f"the bench has no axis '{axis}'; its axes are {', '.join(bench.axes)}")
    return bench.axes.index(axis)


def longest_segment(rate_hz: float) -> int:
    """Return the samples of the longest segment of steady motion."""
    return samples_of(min(SEGMENT_S, MOST_IN_WAVEFORM / rate_hz), rate_hz)


def open_loop(
    label: str,
    command: Array,
    n_samples: int,
    record: tuple[str, ...],
    settings: dict[str, float | str],
    cold_finger_k: float | None = None,
) -> Segment:
    """Return a segment that plays `command` (period, n_axes) with all loops open and a reference of zero."""
    return Segment(
        label=label,
        n_samples=n_samples,
        reference=np.zeros_like(command),
        feedforward=command,
        cold_finger_k=cold_finger_k,
        record=record,
        settings={"phase": "open loop", **settings},
    )


def on_axis(bench: Bench, axis: str, wave: Array) -> Array:
    """Return `wave` (n,) as a waveform (n, n_axes) that is zero on every other axis."""
    out = np.zeros((wave.size, len(bench.axes)))
    out[:, axis_of(bench, axis)] = wave
    return out


def smooth_ramp(start: Array, stop: Array, n_samples: int) -> Array:
    """Return a move (n_samples, n) from `start` to `stop` (n,) along half a cosine, ending on `stop`."""
    way = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, n_samples + 1) / n_samples)
    return np.asarray(start + way[:, None] * (stop - start))


def checked_segments(plan: Plan, bench: Bench) -> Iterator[Segment]:
    """Yield the plan's segments, each checked against the bench's limits and channels.

    Raises ConfigError at the first that breaks a limit, records other channels than the plan says, or uses a label
    twice.
    """
    return (segment for segment, _ in _checked(plan, bench))


def _checked(plan: Plan, bench: Bench) -> Iterator[tuple[Segment, Demand]]:
    """Yield the checked segments, each with what it asks for."""
    channels, limits, labels = plan.channels(bench), bench.limits, set[str]()
    rate, samples = rate_of(bench), 0
    demand, waves = None, (np.empty(0), np.empty(0))
    for segment in plan.segments(bench):
        samples += segment.n_samples
        require_at_once(f"plan {plan.name}: segment '{segment.label}'", segment.n_samples, len(channels), rate)
        require_run(f"plan {plan.name}", samples, len(labels) + 1, len(channels), rate)
        # a stage is cut into segments that play the same waveforms
        if demand is None or segment.reference is not waves[0] or segment.feedforward is not waves[1]:
            demand, waves = check_segment(segment, limits), (segment.reference, segment.feedforward)
        if segment.record != channels or segment.label in labels:
            raise ConfigError(
                f"plan {plan.name}: segment '{segment.label}' repeats a label or records other channels than the plan; "
                "give every segment its own label and the plan's channels"
            )
        labels.add(segment.label)
        yield segment, demand


def estimate(plan: Plan, bench: Bench) -> Estimate:
    """Count a plan without playing it; raises ConfigError as `checked_segments`, and for a plan without segments."""
    limits, axes = bench.limits, bench.axes
    count, samples, current_a = 0, 0, 0.0
    reference = np.zeros(len(axes))
    for segment, demand in _checked(plan, bench):
        count, samples = count + 1, samples + segment.n_samples
        current_a = max(current_a, demand.current_a)
        reference = np.maximum(reference, demand.reference)
    if count == 0:
        raise ConfigError(f"plan {plan.name}: its settings give nothing to play; ask for at least one step")
    columns = len(plan.channels(bench))
    return Estimate(
        plan=plan.name,
        segments=count,
        samples=samples,
        channels=columns,
        duration_s=samples / rate_of(bench),
        bytes=samples * columns * BYTES_PER_VALUE,
        peak_current_a=current_a,
        limit_current_a=float(limits.current_a),
        peak_reference=dict(zip(axes, reference.tolist(), strict=True)),
        limit_reference=dict(zip(axes, limits.reference.tolist(), strict=True)),
    )
