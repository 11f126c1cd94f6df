"""Segments and records as bytes: bit for bit, and nothing but a clear error for what is none."""

from __future__ import annotations

import dataclasses
from itertools import islice

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaigns.benches import open_bench
from campaigns.playing.campaign import load_campaign
from campaigns.serial.program import (
    MAX_WAVE_VALUES,
    decode_record,
    decode_segment,
    encode_record,
    encode_segment,
)
from sim_backend.bench import Gate, Learning, Segment
from sim_backend.control.blocks import filter_from_zpk
from sim_backend.errors import ConfigError

NAMES = ("command_x", "x", "y", "temperature")


def whole() -> Segment:
    """Return a segment that uses every field."""
    rng = np.random.default_rng(1)
    wave = rng.standard_normal((7, 3))
    wave[:, 1] = 0.0
    pi = filter_from_zpk([0.99], [1.0], 0.3, 1e4)
    low = filter_from_zpk([-1.0, 0.2], [0.5 + 0.1j, 0.5 - 0.1j], 0.1, 1e4)
    return Segment(
        "θ 5 Hz",
        2**33,
        wave,
        rng.standard_normal((7, 3)),
        feedback=(pi, None),
        gates=(Gate(6, 2, True, -1e-300), Gate(0, 0, False)),
        learning=(None, None, Learning(low, 0.7, 2, 7, (0.25, 0.5, 0.25), False)),
        cold_finger_k=63.5,
        record=("x", "temperature"),
    )


def same(a: object, b: object) -> bool:
    """Whether two segments are equal bit for bit, apart from the settings, which stay with the host."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.shape == b.shape and a.tobytes() == b.tobytes()
    if dataclasses.is_dataclass(a) and dataclasses.is_dataclass(b):
        names = [f.name for f in dataclasses.fields(a) if f.name != "settings"]
        return type(a) is type(b) and all(same(getattr(a, n), getattr(b, n)) for n in names)
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    return a == b and type(a) is type(b)


def test_every_field_comes_back() -> None:
    assert same(decode_segment(encode_segment(whole(), NAMES), NAMES), whole())


def test_same_can_tell_a_difference() -> None:
    assert not same(whole(), dataclasses.replace(whole(), cold_finger_k=63.6))
    assert not same(whole(), dataclasses.replace(whole(), reference=np.nextafter(whole().reference, 9.0)))


def test_negative_zero_is_not_left_out() -> None:
    wave = np.zeros((4, 2))
    wave[2, 1] = -0.0
    segment = Segment("zeros", 4, wave, np.zeros((4, 2)))
    assert same(decode_segment(encode_segment(segment, NAMES), NAMES), segment)


def test_columns_of_zeros_take_no_bytes() -> None:
    quiet = Segment("quiet", 10, np.zeros((10_000, 3)), np.zeros((10_000, 3)))
    assert len(encode_segment(quiet, NAMES)) < 100


def test_segments_of_every_plan_come_back() -> None:
    bench = open_bench("sim", 0)
    names = tuple(signal.name for signal in bench.signals)
    for plan in load_campaign("quick").plans().values():
        for segment in islice(plan.segments(bench), 4):
            assert same(decode_segment(encode_segment(segment, names), names), segment)


def test_a_channel_that_the_bench_does_not_have() -> None:
    with pytest.raises(ConfigError, match="no channel 'w'; channels: command_x, x, y, temperature"):
        encode_segment(dataclasses.replace(whole(), record=("x", "w")), NAMES)


def test_more_than_a_field_can_count() -> None:
    with pytest.raises(ConfigError, match="does not fit the protocol"):
        encode_segment(dataclasses.replace(whole(), n_samples=2**64), NAMES)


def test_zeros_cannot_ask_for_all_the_memory() -> None:
    """64 bytes on the line that stand for 2^32 samples of 65,535 axes, two petabytes."""
    image = bytearray(encode_segment(Segment("", 1, np.zeros((1, 1)), np.zeros((1, 1))), NAMES))
    image[16:22] = b"\xff" * 6
    with pytest.raises(ConfigError, match=f"{MAX_WAVE_VALUES} values are the limit"):
        decode_segment(bytes(image), NAMES)


@given(st.binary(max_size=400), st.booleans())
def test_no_bytes_but_a_clear_error(noise: bytes, framed: bool) -> None:
    with pytest.raises(ConfigError):
        decode_segment(b"MSEG\x01\x00" + noise if framed else noise, NAMES)


@given(st.lists(st.tuples(st.integers(0, 10_000), st.integers(0, 255)), min_size=1, max_size=6), st.integers(0, 40))
def test_a_changed_image_is_a_segment_or_a_clear_error(changes: list[tuple[int, int]], cut: int) -> None:
    image = bytearray(encode_segment(whole(), NAMES))
    for at, value in changes:
        image[at % len(image)] = value
    try:
        segment = decode_segment(bytes(image[: len(image) - cut]), NAMES)
    except ConfigError:
        return
    assert isinstance(segment, Segment) and np.all(np.isfinite(segment.reference))


def test_a_record_comes_back_row_by_row() -> None:
    x, y = np.arange(5.0), np.array([np.nan, -0.0, np.inf, 5e-324, -1.0])
    image = encode_record([x, y])
    assert image[:32] == np.array([x[0], y[0], x[1], y[1]]).tobytes()
    got = decode_record(image, 5, 2)
    assert [a.tobytes() for a in got] == [x.tobytes(), y.tobytes()]


def test_a_record_of_another_size_is_refused() -> None:
    with pytest.raises(ConfigError, match="a record of 80 bytes"):
        decode_record(bytes(80), 5, 3)
