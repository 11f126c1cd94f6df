"""Feed everything that reads bytes from elsewhere with damaged ones, inside a memory bound, and count what comes of it.

    python -m benchmarks.soak_fuzz --cases 20000

Each reader gets good input with a few bytes flipped, replaced by numbers that are absurd, cut out or repeated; frames
and TOML documents are also made up by hypothesis (`generated`). It must return or end in one clear error; for what
carries a checksum nothing may pass but the original. Each reader works in a process of its own with limited memory.
HDF5 and MATLAB files are first read by a child, as always, but one that is forked instead of started (`forked`).
Exit code 1 if a single case breaks a promise.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import platform
import resource
import sys
from collections import Counter
from collections.abc import Callable
from datetime import UTC, datetime
from functools import cache
from importlib import resources
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np
import scipy.io

from benchmarks.forked import forked
from benchmarks.generated import draw, generated
from campaigns.importing import isolated
from campaigns.importing.isolated import IsolatedSource
from campaigns.importing.mapping import read_map
from campaigns.log import Channel, LogWriter, probe, read_run
from campaigns.playing.campaign import load_campaign
from campaigns.serial.commands import parse_command, parse_error, parse_status
from campaigns.serial.description import decode_description, describe, encode_description
from campaigns.serial.firmware import Firmware
from campaigns.serial.frames import Block, decode_block, encode_block, encode_line, parse_line
from campaigns.serial.program import decode_segment, encode_segment
from campaigns.serial.session import Session
from campaigns.version import tool_commit, tool_version
from sim_backend.bench import Gate, Segment
from sim_backend.control.blocks import filter_from_zpk
from sim_backend.errors import MccdError
from sim_backend.model import dump_model, load_model
from sim_backend.simbench import SimBench

ROUND = 500
HEADROOM_BYTES = 512 * 2**20
ABSURD = (0, 1, 2**15, 2**31 - 1, 2**31, 2**63, 2**64 - 1)
WORDS = (b"9e999", b"-1", b"nan", b"[", b"]", b'"', b"\n", b"\x00", b"\xff\xfe", b"{}", b"true", b"1" * 40, b"../../x")

Reader = Callable[[bytes], object]


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """Return a copy with one to eight changes."""
    out = bytearray(content)
    for _ in range(int(rng.integers(1, 9))):
        at = int(rng.integers(0, max(len(out), 1)))
        match int(rng.integers(0, 6)):
            case 0 if at < len(out):
                out[at] ^= 1 << int(rng.integers(0, 8))
            case 1:
                out[at : at + 8] = int(rng.choice(np.array(ABSURD, dtype=np.uint64))).to_bytes(8, "little")
            case 2:
                del out[at : at + int(rng.integers(1, 64))]
            case 3:
                out[at:at] = out[at : at + int(rng.integers(1, 64))]
            case 4:
                out[at : at + int(rng.integers(0, 6))] = WORDS[int(rng.integers(0, len(WORDS)))]
            case _:
                out[at : at + 1] = rng.bytes(1)
    return bytes(out)


def _segment() -> tuple[bytes, tuple[str, ...]]:
    bench = SimBench(load_model("as-built"), 1)
    names = tuple(signal.name for signal in bench.signals)
    wave = np.random.default_rng(1).standard_normal((20, 3))
    pi = filter_from_zpk([0.99], [1.0], 0.3, 1e4)
    segment = Segment("a", 50, wave, wave, feedback=(pi, None, pi), gates=(Gate(1, 0, True, 0.1),), record=("theta_x",))
    return encode_segment(segment, names), names


def _line(case: bytes) -> object:
    line = parse_line(case.strip(b"\n"))
    if line is None:
        return None
    if line.tag is not None and (line.text, line.tag) != ("SEGM:BEG 12,34567,3735928559", 0xA7):
        raise AssertionError(f"a damaged line passes its checksum: {line}")
    return parse_command(line.text), parse_status(line.text), parse_error(line.text)


def _block(case: bytes) -> object:
    block = decode_block(case, 700)
    if block != Block(3, 4, bytes(700)):
        raise AssertionError("a damaged block passes its checksum")
    return block


def _talk(case: bytes) -> object:
    firmware = Firmware(SimBench(load_model("design"), 1), count(1))
    session = Session(firmware)
    session.feed(case, 0.0)
    session.tick(10.0)
    session.feed(encode_line("SYST:VERS?", 9), 10.0)
    if b"MCCD/1 @0009" not in b"".join(iter(session.next_bytes, b"")):
        raise AssertionError("the firmware no longer answers")
    return None


def _file(name: str, read: Callable[[Path], object]) -> Reader:
    def reader(case: bytes) -> object:
        with TemporaryDirectory(prefix="mccd-fuzz-") as folder:
            path = Path(folder) / name
            path.write_bytes(case)
            return read(path)

    return reader


def _read_log(path: Path) -> object:
    with read_run(path) as run:
        return [block for block in run.blocks()][:1]


def _read_source(path: Path) -> object:
    with IsolatedSource(path) as source:
        return [source.names(), source.all_names(), *(source.array(name) for name in ("x", "s.y", "s/y"))]


def _source_bytes(kind: str) -> bytes:
    values = np.random.default_rng(2).normal(size=200)
    with TemporaryDirectory(prefix="mccd-fuzz-") as folder:
        path = Path(folder) / "a"
        if kind == "matlab":
            scipy.io.savemat(path, {"x": values, "s": {"y": values}}, appendmat=False, do_compression=True)
        else:
            with h5py.File(path, "w", userblock_size=512 if kind == "matlab 7.3" else 0) as file:
                file.create_dataset("x", data=values, chunks=(64,), compression=4, fletcher32=True)
                file["s/y"] = values
        return path.read_bytes()


def _log_bytes() -> bytes:
    with TemporaryDirectory(prefix="mccd-fuzz-") as folder:
        path = Path(folder) / "run.h5"
        channels = [Channel(name, "rad", "output", "z", 1e4) for name in ("a", "b")]
        with LogWriter.create(path, channels, test="fuzz", bench={"kind": "sim"}, chunk_rows=64) as log:
            with log.segment("all", {"part": 1}):
                log.append({"a": np.arange(200.0), "b": np.arange(200.0)})
        return path.read_bytes()


MAP = b"""[log]
test = "free-run"
source = "a.npz"
sample_rate_hz = 10.0
[channels.x]
select = "u[:, 1]"
unit = "mrad"
role = "output"
dof = "z"
"""


@cache
def readers() -> dict[str, tuple[bytes, Reader]]:
    """Return what is damaged and who reads it, by name."""
    image, names = _segment()
    about = describe(SimBench(load_model("as-built"), 1), travel_factor=2.0, current_factor=1.05, memory_bytes=10**6)
    talk = b"".join(encode_line(text, 1) for text in ("SYST:LOCK me", f"SEGM:BEG 1,{len(image)},7", "SEGM:DATA 1,0,1"))
    quick = (resources.files("campaigns") / "quick.toml").read_bytes()
    model = dump_model(load_model("as-built")).encode()
    return {
        "line": (encode_line("SEGM:BEG 12,34567,3735928559", 0xA7), _line),
        "block": (encode_block(Block(3, 4, bytes(700))), _block),
        "conversation with the firmware": (talk + encode_block(Block(1, 0, image[:1024])), _talk),
        "segment image": (image, lambda case: decode_segment(case, names)),
        "description of a bench": (encode_description(about), decode_description),
        "model": (model, _file("model.toml", load_model)),
        "campaign": (quick, _file("campaign.toml", load_campaign)),
        "import map": (MAP, _file("map.toml", read_map)),
        "log (HDF5)": (_log_bytes(), _file("run.h5", _read_log)),
        "import source (HDF5)": (_source_bytes("hdf5"), _file("a.h5", _read_source)),
        "import source (MATLAB 5)": (_source_bytes("matlab"), _file("a.mat", _read_source)),
        "import source (MATLAB 7.3)": (_source_bytes("matlab 7.3"), _file("a.mat", _read_source)),
    }


def bound_worker() -> None:
    """Limit the memory of this process for good, and let it fork its children."""
    mapped = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (mapped + HEADROOM_BYTES, mapped + HEADROOM_BYTES))
    probe.start_python = isolated.start_python = forked


def fuzz(task: tuple[str, int, int]) -> tuple[str, Counter[str], list[str]]:
    """Damage one input, or make up one kind of it: so many cases from the first; return the counts, and what broke."""
    name, first, cases = task
    bound_worker()
    made_up = generated(MAP.decode())
    if name in made_up:
        return name, *draw(name, *made_up[name], first, cases)
    content, read = readers()[name]
    tally, broken = Counter[str](), []
    read(content)
    for seed in range(first, first + cases):
        try:
            read(damaged(content, np.random.default_rng([seed, len(name)])))
            tally["read"] += 1
        except MccdError:
            tally["refused"] += 1
        except Exception as error:
            tally["broken"] += 1
            broken.append(f"{name}, case {seed}: {type(error).__name__}: {error}"[:300])
    return name, tally, broken


def summary(code: str, asked: int, tallies: dict[str, Counter[str]], broken: list[str]) -> dict[str, object]:
    """Count what happened."""
    return {
        "mccd": code,
        "machine": f"Python {platform.python_version()}, {platform.system()} {platform.machine()}",
        "command": " ".join(["python -m benchmarks.soak_fuzz", *sys.argv[1:]]),
        "memory_headroom_bytes": HEADROOM_BYTES,
        "cases_asked_of_each": asked,
        "cases_in_all": sum(tally.total() for tally in tallies.values()),
        "cases": {name: dict(tally) for name, tally in tallies.items()},
        "broken": broken[:100],
    }


def main() -> int:
    """Run the fuzz in rounds over all readers and write its result after each part, so that it may be stopped."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=20_000)
    parser.add_argument("--only", action="append", metavar="NAME", help="one reader instead of all; repeatable")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / f"fuzz-{datetime.now(UTC):%Y-%m-%d}.json"
    code = f"{tool_version()} (commit {tool_commit()})"
    names = options.only or [*readers(), *generated(MAP.decode())]  # made once, before workers are forked
    tallies = {name: Counter[str]() for name in names}
    broken: list[str] = []
    firsts = range(0, options.cases, ROUND)
    tasks = [(name, first, min(ROUND, options.cases - first)) for first in firsts for name in names]
    with multiprocessing.get_context("fork").Pool(options.workers, maxtasksperchild=1) as pool:
        for name, tally, found in pool.imap_unordered(fuzz, tasks):
            tallies[name] += tally
            broken += found
            text = json.dumps(summary(code, options.cases, tallies, broken), indent=2)
            path.write_text(text + "\n", encoding="utf-8")
    print(path.read_text(encoding="utf-8"))
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
