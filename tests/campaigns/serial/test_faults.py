"""Seeded faults: as often as they say, the same for the same seed, however the bytes are cut."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaigns.serial.faults import KINDS, Event, FaultSpec, FaultyLine, drawn_spec, parse_faults
from sim_backend.errors import ConfigError


def line(spec: FaultSpec, seed: int = 1) -> FaultyLine:
    return FaultyLine(spec, np.random.default_rng(seed))


def joined(parts: list[bytes | Event]) -> list[bytes | Event]:
    """Merge neighbouring bytes, for how they are cut says nothing."""
    out: list[bytes | Event] = []
    for part in parts:
        if isinstance(part, bytes) and out and isinstance(out[-1], bytes):
            out[-1] += part
        elif part != b"":
            out.append(part)
    return out


@given(st.binary(min_size=1, max_size=400))
def test_without_faults_everything_passes(data: bytes) -> None:
    assert joined(line(FaultSpec()).pass_on(data)) == [data]


@given(st.lists(st.integers(1, 300), max_size=10))
def test_faults_do_not_depend_on_how_bytes_are_cut(cuts: list[int]) -> None:
    # a loss or a repetition ends with the piece it strikes, so these two are left out
    spec = FaultSpec(flip=0.01, garbage=0.01, delay=0.01, stall=0.005, reset=0.005, drop=0.002)
    data = bytes(range(256)) * 8
    whole = joined(line(spec).pass_on(data))
    pieces, cut = [], line(spec)
    for size in [*cuts, len(data)]:
        pieces += cut.pass_on(data[:size])
        data = data[size:]
    assert joined(pieces) == whole


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_strikes_as_often_as_it_says(kind: str) -> None:
    """In n bytes at rate p: n p strikes with a standard deviation of sqrt(n p); five of them is 1 in 3 million."""
    n, rate = 200_000, 1e-3
    faulty = line(FaultSpec(**{kind: rate}))
    for _ in range(n // 1000):
        faulty.pass_on(bytes(1000))
    assert abs(faulty.struck[kind] - n * rate) < 5 * math.sqrt(n * rate)
    assert sum(faulty.struck.values()) == faulty.struck[kind]


def test_what_each_kind_does() -> None:
    data = bytes(range(200))
    assert sum(a != b for a, b in zip(_bytes("flip", data), data, strict=True)) >= 1
    assert len(_bytes("lose", data)) < len(data)
    assert len(_bytes("repeat", data)) > len(data)
    assert len(_bytes("garbage", data)) > len(data)
    for kind in ("delay", "drop", "reset", "stall"):
        assert _bytes(kind, data) == data
        events = [p for p in line(FaultSpec(**{kind: 0.05})).pass_on(data) if isinstance(p, Event)]
        assert events and all(e.kind == kind and 0.0 <= e.duration_s <= 4.0 for e in events)


def _bytes(kind: str, data: bytes) -> bytes:
    return b"".join(p for p in line(FaultSpec(**{kind: 0.05})).pass_on(data) if isinstance(p, bytes))


def test_a_seed_alone_draws_kinds_and_rates() -> None:
    assert parse_faults("12") == (12, drawn_spec(12)) == parse_faults("12")
    struck = {kind for seed in range(60) for kind in KINDS if getattr(drawn_spec(seed), kind)}
    assert struck == set(KINDS)


def test_rates_as_written() -> None:
    assert parse_faults("7/flip=1e-4,drop=1e-5") == (7, FaultSpec(flip=1e-4, drop=1e-5))


@pytest.mark.parametrize("text", ["", "x", "-1", "7/flip", "7/flip=x", "7/burn=0.1", "7/flip=2", "7/flip=nan"])
def test_what_is_no_fault_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="faults"):
        parse_faults(text)
