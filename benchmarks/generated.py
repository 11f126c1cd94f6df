"""Frames and TOML documents that hypothesis makes up, for the fuzz: of the right words in any order, and of others."""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Callable, Iterator
from importlib import resources
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import tomli_w
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from campaigns.importing.mapping import read_map
from campaigns.playing.campaign import parse_campaign
from campaigns.serial.commands import HEADERS
from campaigns.serial.firmware import Firmware
from campaigns.serial.frames import Block, Receiver, encode_block, encode_line
from campaigns.serial.session import Session
from sim_backend.bench import Segment
from sim_backend.errors import MccdError
from sim_backend.model import dump_model, load_model, parse_model
from sim_backend.simbench import SimBench

Change = tuple[int, str, Any]

WORDS = st.sampled_from(
    ["value", "name", "unit", "dof", "theta_x", "sample", "sensor-noise", "S1", "as-built", "a.npz", ""]
)
NUMBERS = st.floats() | st.integers(-(2**70), 2**70) | st.sampled_from([0, -1, 1e300, 1e-300, 1e18, 2**31])
LEAVES = NUMBERS | st.booleans() | WORDS | st.text(max_size=20) | st.datetimes()
VALUES = st.recursive(
    LEAVES, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(WORDS | st.text(max_size=8), inner, max_size=4)
)
CHANGES = st.lists(
    st.tuples(st.integers(0, 10**6), st.sampled_from(["replace", "remove", "add"]), VALUES), min_size=1, max_size=3
)
COMMANDS = st.builds(
    lambda header, words, tag: encode_line(f"{header} {','.join(map(str, words))}".strip(), tag),
    st.sampled_from([form for pair in HEADERS.items() for form in pair]),
    st.lists(st.integers(0, 2**34) | st.sampled_from(["me", "-1", "1.5", "nan", ""]), max_size=4),
    st.none() | st.integers(0, 0xFFFF),
)
BLOCKS = st.builds(
    lambda run, sequence, data: encode_block(Block(run, sequence, data)),
    st.integers(0, 3),
    st.integers(0, 3),
    st.binary(max_size=60),
)
PIECES = st.lists(COMMANDS | BLOCKS | st.binary(max_size=80), max_size=12)


def changed(document: dict[str, Any], changes: list[Change]) -> str:
    """Return the TOML of a sound document with some of its nodes replaced, removed or put elsewhere."""
    for at, what, value in changes:
        nodes = list(_nodes(document))
        holder, key = nodes[at % len(nodes)]
        if what == "remove":
            del holder[key]
        elif what == "add" and isinstance(holder, dict):
            holder[f"{key}2"] = value
        else:
            holder[key] = value
        if not document:
            break
    return tomli_w.dumps(document)


def _nodes(node: Any) -> Iterator[tuple[Any, Any]]:
    for key, value in list(node.items()) if isinstance(node, dict) else list(enumerate(node)):
        yield node, key
        if isinstance(value, dict | list):
            yield from _nodes(value)


def converse(pieces: list[bytes]) -> None:
    """Let host and firmware hear the same bytes; the firmware must still answer, and must have played nothing."""
    receiver = Receiver()
    firmware = Firmware(SimBench(load_model("design"), 1), count(1))
    session = Session(firmware)
    for number, piece in enumerate(pieces):
        receiver.feed(piece)
        while receiver.line() is not None:
            pass
        session.feed(piece, 0.1 * number)
        session.tick(0.1 * number)
    session.tick(10.0)
    session.feed(encode_line("SYST:VERS?", 9), 10.0)
    if b"MCCD/1 @0009" not in b"".join(iter(session.next_bytes, b"")) or not firmware.safe:
        raise AssertionError("the firmware no longer answers, or has played")


def model(text: str) -> None:
    """Read a model and, if it is one, play it: its record holds finite numbers."""
    bench = SimBench(parse_model(text, "fuzz"), 1)
    still = np.zeros((10, len(bench.axes)))
    for values in bench.play(Segment("a", 20, still, still)).channels.values():
        if not np.all(np.isfinite(values)):
            raise AssertionError("a record holds no numbers")


def import_map(text: str) -> None:
    """Read a map from a file."""
    with TemporaryDirectory(prefix="mccd-fuzz-") as folder:
        path = Path(folder) / "map.toml"
        path.write_text(text, encoding="utf-8")
        read_map(path)


def generated(map_text: str) -> dict[str, tuple[Any, Callable[[Any], object]]]:
    """Return, by name, what hypothesis draws from and who reads it."""
    quick = (resources.files("campaigns") / "quick.toml").read_text()

    def toml(text: str) -> st.SearchStrategy[str]:
        return CHANGES.map(lambda changes: changed(tomllib.loads(text), changes))

    return {
        "frames (hypothesis)": (PIECES, converse),
        "TOML as a model (hypothesis)": (toml(dump_model(load_model("as-built"))), model),
        "TOML as a campaign (hypothesis)": (toml(quick), lambda text: parse_campaign(text, "fuzz")),
        "TOML as an import map (hypothesis)": (toml(map_text), import_map),
    }


def draw(
    name: str, strategy: Any, read: Callable[[Any], object], first: int, cases: int
) -> tuple[Counter[str], list[str]]:
    """Read so many examples, drawn with the seed `first`; return the counts, and what broke."""
    tally: Counter[str] = Counter()
    broken: list[str] = []

    @seed(first)
    @settings(
        max_examples=cases,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(strategy)
    def example(case: Any) -> None:
        try:
            read(case)
            tally["read"] += 1
        except MccdError:
            tally["refused"] += 1
        except Exception as error:
            tally["broken"] += 1
            broken.append(f"{name}: {type(error).__name__}: {error}"[:300] + f" from {case!r:.2000}")

    example()
    return tally, broken
