"""Run `mccd` in this process and write where its time and its memory went.

    python -m benchmarks.speed.sampled LIBRARY OUT.json ARGUMENTS…

Two things are sampled. Where the processor is, by the timer of `sampler.c` (LIBRARY, compiled; `-` without a compiler):
the code that an instruction belongs to says whether it was compiled or Python's own. And which function runs, every few
milliseconds and in every thread, with what the process's memory grew by meanwhile.
"""

from __future__ import annotations

import ctypes
import json
import os
import sys
import threading
import time
from bisect import bisect_right
from collections import Counter, defaultdict
from pathlib import Path
from types import FrameType
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
EVERY_US, EVERY_S = 997, 0.005
"""Processor time between two looks at the instruction pointer, and time between two at the stacks."""
ROOM = 1 << 20
LINES = 12
"""Functions that are told, by time and by memory."""
WAITING = ("threading.py", "queue.py", "selectors.py", "subprocess.py", "thread.py", "_base.py")
"""Files of Python's own in which a thread waits."""

NUMBA, LIBRARIES, MATHS = "compiled by numba and llvmlite", "compiled libraries", "C mathematics"
PYTHON, COMPILER, C, ELSEWHERE = "Python", "compiling", "C library", "elsewhere"
COMPILED = (NUMBA, LIBRARIES, MATHS)
"""What counts as compiled code. The C library, which both sides call, does not."""


def group_of(mapped: str) -> str:
    """Return the kind of code that a mapped file holds; no file is code made while running."""
    name = Path(mapped).name
    if not mapped:
        return NUMBA
    if name.startswith(("python", "libpython")) or "lib-dynload" in mapped:
        return PYTHON
    if "llvmlite" in mapped or name.startswith("libLLVM"):
        return COMPILER
    if name.startswith(("libm.", "libm-", "libmvec")):
        return MATHS
    if name.startswith(("libc.", "libc-", "ld-", "libpthread", "[v")):
        return C
    return LIBRARIES if ".so" in name else ELSEWHERE


def shares(pointers: list[int], maps: str) -> dict[str, float]:
    """Return the parts of samples by kind of code, from the lines of /proc/self/maps."""
    starts, stops, groups = [], [], []
    for line in maps.splitlines():
        fields = line.split(maxsplit=5)
        low, high = (int(word, 16) for word in fields[0].split("-"))
        starts.append(low)
        stops.append(high)
        groups.append(group_of(fields[5]) if len(fields) > 5 else NUMBA)
    found: Counter[str] = Counter()
    for pointer in pointers:
        k = bisect_right(starts, pointer) - 1
        found[groups[k] if k >= 0 and pointer < stops[k] else ELSEWHERE] += 1
    return {name: n / len(pointers) for name, n in found.most_common()}


def name_of(frame: FrameType) -> tuple[str, int] | None:
    """Return which function runs, and at which line of this project; None where a thread waits.

    A function of a library is told with the one of this project that called it.
    """
    if Path(frame.f_code.co_filename).name in WAITING:
        return None
    own: FrameType | None = frame
    while own is not None and not _ours(own):
        own = own.f_back
    if own is None:
        return _place(frame), frame.f_lineno
    return (_place(own) if own is frame else f"{_place(frame)}, called by {_place(own)}"), own.f_lineno


def _ours(frame: FrameType) -> bool:
    """Tell whether a function is this project's: an environment with libraries may lie in its folder."""
    path = Path(frame.f_code.co_filename)
    return path.is_relative_to(ROOT) and "site-packages" not in path.parts


def _place(frame: FrameType) -> str:
    path = Path(frame.f_code.co_filename)
    return f"{frame.f_code.co_name} ({'/'.join(path.parts[-2:])})"


class Stacks(threading.Thread):
    """Looks at all other threads: `seconds` and `grown_mb` by function, summed over threads that do not wait.

    `most_mb` is the most memory that was held at a look, with the functions that ran then.

    `lines` holds how often each line of a function was met: the one of a call into compiled code names that code.
    """

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self.grown_mb: defaultdict[str, float] = defaultdict(float)
        self.lines: defaultdict[str, Counter[int]] = defaultdict(Counter)
        self.most_mb: tuple[float, list[str]] = 0.0, []
        self.ended = threading.Event()

    def run(self) -> None:
        """Look until `ended`; a look that comes late, since compiled code kept the interpreter, counts for longer."""
        last, held = time.perf_counter(), resident_mb()
        while not self.ended.wait(EVERY_S):
            now, holds = time.perf_counter(), resident_mb()
            frames = [f for thread, f in sys._current_frames().items() if thread != self.ident]  # noqa: SLF001
            met = [at for at in map(name_of, frames) if at is not None]
            for name, line in met:
                self.seconds[name] += now - last
                self.grown_mb[name] += (holds - held) / len(met)
                self.lines[name][line] += 1
            if met and holds > self.most_mb[0]:
                self.most_mb = holds, [f"{name}, line {line}" for name, line in met]
            last, held = now, holds

    def most(self, of: dict[str, float]) -> list[tuple[str, float]]:
        """Return the functions with the most of something, with the line at which each was met most often."""
        told = sorted(of.items(), key=lambda item: -item[1])[:LINES]
        return [(f"{name}, mostly line {self.lines[name].most_common(1)[0][0]}", value) for name, value in told]


def resident_mb() -> float:
    """Return the memory that this process holds, in MB of 10⁶ bytes; 0 where the system does not tell."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    except OSError:
        return 0.0


def main(library: str, out: Path, arguments: list[str]) -> int:
    """Run the command, write what was seen, and return its exit code."""
    from mccdcli.main import main as mccd

    native = None if library == "-" else ctypes.CDLL(library)
    stacks = Stacks()
    stacks.start()
    if native is not None and native.begin(ctypes.c_long(EVERY_US)) != 0:
        native = None
    started = time.perf_counter()
    code = mccd(arguments)
    seconds = time.perf_counter() - started
    found: dict[str, Any] = {"seconds": seconds, "processor_s": time.process_time(), "shares": None}
    if native is not None:
        buffer = (ctypes.c_size_t * ROOM)()
        native.end.restype = ctypes.c_size_t
        taken = native.end(buffer, ctypes.c_size_t(ROOM))
        found["samples"] = taken
        found["shares"] = shares(list(buffer[:taken]), Path("/proc/self/maps").read_text()) if taken else None
    stacks.ended.set()
    stacks.join()
    found["stacks_s"], found["own_time"] = sum(stacks.seconds.values()), stacks.most(stacks.seconds)
    found["grown_mb"] = stacks.most(stacks.grown_mb)
    found["most_mb"], found["most_in"] = stacks.most_mb
    out.write_text(json.dumps(found), encoding="utf-8")
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], Path(sys.argv[2]), sys.argv[3:]))
