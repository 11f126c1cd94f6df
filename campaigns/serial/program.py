"""A segment as bytes: the image that the host uploads before it arms the bench; docs/serial-protocol.md has its fields.

All numbers are little-endian and packed without gaps; floating-point numbers are IEEE 754 doubles, so that what the
bench plays is bit for bit what the host meant. A waveform column that is zero throughout takes no bytes.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_backend.bench import Gate, Learning, Segment
from sim_backend.control.blocks import DiscreteFilter
from sim_backend.errors import ConfigError

Array = NDArray[np.float64]

MAGIC = b"MSEG"
VERSION = 1
MAX_LABEL_BYTES = 255
MAX_WAVE_VALUES = 20_000_000
"""Values of a waveform: columns of zeros take no bytes, so only this bounds the memory that an image asks for."""

_HEAD = struct.Struct("<4sHHQIHHIHHd")
_GATE = struct.Struct("<IHHd")
_FILTER = struct.Struct("<Hhdd")
_LEARNING = struct.Struct("<dIIHH")


def encode_segment(segment: Segment, channels: tuple[str, ...]) -> bytes:
    """Return the image of `segment`; `channels` are all of the bench's in its order.

    Raises ConfigError for a channel that the bench does not have, or more of anything than a field can count.
    """
    label = _cut(segment.label.encode(), MAX_LABEL_BYTES)
    unknown = sorted(set(segment.record) - set(channels))
    if unknown:
        raise ConfigError(
            f"segment '{segment.label}': the bench has no channel '{unknown[0]}'; channels: {', '.join(channels)}"
        )
    finger = np.nan if segment.cold_finger_k is None else segment.cold_finger_k
    period, n_axes = segment.reference.shape
    wanted = [i for i, name in enumerate(channels) if name in segment.record]
    try:
        parts = [
            _HEAD.pack(
                MAGIC,
                VERSION,
                len(label),
                segment.n_samples,
                period,
                n_axes,
                len(wanted),
                len(segment.gates),
                len(segment.feedback),
                len(segment.learning),
                finger,
            ),
            label,
            np.array(wanted, dtype="<u2").tobytes(),
            *(_GATE.pack(g.at_sample, g.axis, g.closed, g.integrator) for g in segment.gates),
            *(_encode_filter(f) for f in segment.feedback),
            *(_encode_learning(one) for one in segment.learning),
            _encode_wave(segment.reference),
            _encode_wave(segment.feedforward),
        ]
    except (struct.error, OverflowError) as error:
        raise ConfigError(f"segment '{segment.label}': does not fit the protocol ({error}); split it") from None
    return b"".join(parts)


def decode_segment(image: bytes, channels: tuple[str, ...]) -> Segment:
    """Return the segment of an image; raises ConfigError when it holds none, or one that cannot be."""
    source = _Source(image)
    magic, version, n_label, n_samples, period, n_axes, n_channels, n_gates, n_feedback, n_learning, finger = (
        source.take(_HEAD)
    )
    if magic != MAGIC or version != VERSION:
        raise ConfigError(f"segment image: {magic!r} version {version}; this bench reads {MAGIC!r} version {VERSION}")
    label = source.bytes(n_label).decode("utf-8", "replace")
    wanted = source.numbers(n_channels, "<u2")
    if np.any(wanted >= len(channels)):
        raise ConfigError(f"segment '{label}': channel {int(wanted.max())} of {len(channels)}; ask for those there are")
    gates = []
    for _ in range(n_gates):
        at_sample, axis, closed, integrator = source.take(_GATE)
        if axis >= n_axes or not np.isfinite(integrator):
            raise ConfigError(
                f"segment '{label}': a gate for axis {axis + 1} of {n_axes} that starts the integrator at "
                f"{integrator}; name an axis there is and a finite number"
            )
        gates.append(Gate(at_sample, axis, bool(closed), integrator))
    if not np.isnan(finger) and not 0.0 < finger < np.inf:
        raise ConfigError(f"segment '{label}': a cold finger of {finger} K; it must be a finite number above zero")
    segment = Segment(
        label=label,
        n_samples=n_samples,
        feedback=tuple(_decode_filter(source) for _ in range(n_feedback)),
        gates=tuple(gates),
        learning=tuple(_decode_learning(source) for _ in range(n_learning)),
        reference=_decode_wave(source, period, n_axes),
        feedforward=_decode_wave(source, period, n_axes),
        cold_finger_k=None if np.isnan(finger) else finger,
        record=tuple(channels[i] for i in wanted),
    )
    source.end()
    return segment


def record_channels(segment: Segment, channels: tuple[str, ...], by_default: tuple[str, ...]) -> tuple[str, ...]:
    """Return the channels of a segment's record in the bench's order; all of `by_default` when it names none."""
    return tuple(name for name in channels if name in (segment.record or by_default))


def encode_record(columns: list[Array]) -> bytes:
    """Return channels (n,) each as rows of doubles, sample after sample as a bench takes them."""
    return np.stack(columns, axis=1).astype("<f8", copy=False).tobytes()


def decode_record(image: bytes, n_samples: int, n_channels: int) -> list[Array]:
    """Return the channels (n_samples,) of a record; raises ConfigError when it has another size."""
    if len(image) != 8 * n_samples * n_channels:
        raise ConfigError(
            f"a record of {len(image)} bytes; {n_samples} samples of {n_channels} channels take "
            f"{8 * n_samples * n_channels}: repeat the segment"
        )
    rows = np.frombuffer(image, dtype="<f8").reshape(n_samples, n_channels)
    return [np.ascontiguousarray(rows[:, i], dtype=float) for i in range(n_channels)]


class _Source:
    """An image read from front to back, never beyond its end."""

    def __init__(self, image: bytes) -> None:
        self._image = image
        self._at = 0

    def bytes(self, count: int) -> bytes:
        if count > len(self._image) - self._at:
            raise ConfigError(
                f"segment image: {count} bytes wanted at {self._at}, it has {len(self._image)}; upload it again"
            )
        self._at += count
        return self._image[self._at - count : self._at]

    def take(self, layout: struct.Struct) -> tuple[Any, ...]:
        return layout.unpack(self.bytes(layout.size))

    def numbers(self, count: int, kind: str) -> NDArray[Any]:
        return np.frombuffer(self.bytes(count * np.dtype(kind).itemsize), dtype=kind)

    def end(self) -> None:
        if self._at != len(self._image):
            raise ConfigError(f"segment image: {len(self._image) - self._at} bytes beyond its end; upload it again")


def _encode_filter(given: DiscreteFilter | None) -> bytes:
    """Return blocks, integrator, rate, d, then a, b and c; a filter that is absent has the integrator -2."""
    if given is None:
        return _FILTER.pack(0, -2, 0.0, 0.0)
    head = _FILTER.pack(
        given.n_blocks, -1 if given.integrator is None else given.integrator, given.rate_hz, float(given.d)
    )
    return head + b"".join(np.asarray(part, dtype="<f8").tobytes() for part in (given.a, given.b, given.c))


def _decode_filter(source: _Source) -> DiscreteFilter | None:
    n, integrator, rate_hz, d = source.take(_FILTER)
    if integrator == -2:
        return None
    a, b, c = (source.numbers(n * size, "<f8").astype(float) for size in (4, 2, 2))
    return DiscreteFilter(
        a.reshape(n, 2, 2), b.reshape(n, 2), c.reshape(n, 2), d, rate_hz, None if integrator < 0 else integrator
    )


def _encode_learning(given: Learning | None) -> bytes:
    """Return gain, lead, period, active, number of taps, the taps and the filter; absent: no taps."""
    if given is None:
        return _LEARNING.pack(0.0, 0, 0, 0, 0)
    head = _LEARNING.pack(given.gain, given.lead, given.period, given.active, len(given.taps))
    return head + np.array(given.taps, dtype="<f8").tobytes() + _encode_filter(given.filter)


def _decode_learning(source: _Source) -> Learning | None:
    gain, lead, period, active, n_taps = source.take(_LEARNING)
    if n_taps == 0:
        return None
    taps = tuple(source.numbers(n_taps, "<f8").tolist())
    given = _decode_filter(source)
    if given is None:
        raise ConfigError("segment image: a learning has no filter; send one with it")
    if not np.all(np.isfinite([gain, *taps])):
        raise ConfigError("segment image: gain or taps of a learning are not finite; send finite numbers")
    return Learning(given, gain, lead, period, taps, bool(active))


def _encode_wave(wave: Array) -> bytes:
    """Return one byte per axis, 1 where the column follows, then those columns."""
    bits = np.ascontiguousarray(wave, dtype="<f8").view("<u8")
    there = np.any(bits != 0, axis=0)  # by bits: a negative zero is not left out
    return there.astype("u1").tobytes() + b"".join(wave[:, i].astype("<f8").tobytes() for i in np.flatnonzero(there))


def _decode_wave(source: _Source, period: int, n_axes: int) -> Array:
    if period * n_axes > MAX_WAVE_VALUES:
        raise ConfigError(
            f"segment image: {period} samples of {n_axes} axes; {MAX_WAVE_VALUES} values are the limit, split it"
        )
    there = source.numbers(n_axes, "u1")
    wave = np.zeros((period, n_axes))
    for i in np.flatnonzero(there):
        wave[:, i] = source.numbers(period, "<f8")
    return wave


def _cut(text: bytes, length: int) -> bytes:
    return text[:length].decode("utf-8", "ignore").encode()
