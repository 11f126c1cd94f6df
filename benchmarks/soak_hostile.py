"""Feed every command with hostile options, words and files, and count what comes of it.

    python -m benchmarks.soak_hostile --seconds 3600

Each case is a process of its own, forked from one that has imported everything, in a copy of a folder of small sound
files, with limited memory and time. It must end with an exit code that is documented, never with 70, without a
traceback, and touch nothing outside its folder. Where only logs or compiled code are damaged, whose bytes have digests,
whatever comes out is what sound ones give. Exit code 1 if a single case breaks a promise.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from benchmarks.hostile_cases import BASES, KERNELS, PLAYS, Drawn, drawn, sound
from benchmarks.hostile_child import LIMIT_S, in_child
from benchmarks.hostile_kit import fill_kernels, make_kit
from benchmarks.hostile_results import results
from mccdcli.main import main as mccd

DOCUMENTED = {0, 1, 2, 3, 4, 130, 141}
SERVED_S = 5.0
"""After which what goes on until it is told is told to stop: a bench that is served, a log that is waited for."""

LONG = 10
"""By how much more time `challenge make` has: a case of every family left out is minutes of honest work."""


TELLS_OF_DAMAGE = {("log", "verify"), ("log", "list"), ("log", "recover"), ("log", "check"), ("campaign", "show")}
"""Commands that end well where a log is damaged: to tell of it is what they do."""


class Ended(NamedTuple):
    """What came of a case: its command, its exit code, what is broken, and what it was in words."""

    command: str
    code: int
    broken: str | None
    shown: str


def case(seed: int, kit: Path, box: Path, known: dict[int, dict[str, str]]) -> Ended:
    """Carry out a case in the empty folder `box`; `known` holds the results of sound command lines, and gets more."""
    one = drawn(seed)
    began = time.monotonic()
    code, said, found = _carried_out(one, kit, box)
    shown = (
        f"seed {seed}: mccd {' '.join(a[:60] for a in one.arguments)!r} ({one.told[:300]}; "
        f"{time.monotonic() - began:.1f} s)"
    )
    # what only waits has nothing to make safe, and may end by the signal itself
    broken = _broken(0 if "--wait" in one.arguments and code == -signal.SIGTERM else code, said)
    base = seed % len(BASES)
    if broken is None and one.checked and code in (0, 1) and BASES[base][:2] not in TELLS_OF_DAMAGE:
        if base not in known:
            known[base] = _known(seed, kit, box)
        others = [name for name, digest in known[base].items() if found.get(name, digest) != digest]
        broken = f"other numbers in {', '.join(others)}" if others else None
    return Ended(" ".join(BASES[base][:2]), code, broken and f"{broken}: {shown}: {said[-600:]}", shown)


def _known(seed: int, kit: Path, box: Path) -> dict[str, str]:
    """Return what a sound command line gives, of that what it gives every time."""
    first, second = (_carried_out(sound(seed), kit, box)[2] for _ in range(2))
    return {name: digest for name, digest in first.items() if second.get(name) == digest}


def _carried_out(one: Drawn, kit: Path, box: Path) -> tuple[int, str, dict[str, str]]:
    """Carry out a case; return its exit code, its words, and digests of what it gives."""
    shutil.rmtree(box)
    work = box / "work"
    shutil.copytree(kit, work, symlinks=True)
    for name in ("home", "tmp"):
        (box / name).mkdir()
    if one.checked and tuple(one.arguments) in PLAYS:
        if not (kit.parent / KERNELS).exists():
            fill_kernels(kit)
        shutil.copytree(kit.parent / KERNELS, box / KERNELS)
    here = os.getcwd()
    os.chdir(work)
    try:
        for change in one.changes:
            change()
    finally:
        os.chdir(here)
    before = {path for path in work.rglob("*") if path.is_file()}
    stop_s = SERVED_S if one.arguments[:2] == ["bench", "serve"] or "--wait" in one.arguments else None
    limit_s = LIMIT_S * (LONG if one.arguments[:2] == ["challenge", "make"] else 1)
    # whoever names a folder outside gets what was asked for there, and nothing deeper
    named = {Path(a): set(os.listdir(a)) for a in one.arguments if a.startswith("/") and os.path.isdir(a)}
    code, said = in_child(lambda: mccd(one.arguments), work, limit_s, watched=[box, *named], stop_s=stop_s)
    for folder, there in named.items():
        for left in set(os.listdir(folder)) - there:
            if (folder / left).is_file():
                (folder / left).unlink()
    return code, said, results(said, work, before) if one.checked and code in (0, 1) else {}


def _broken(code: int, said: str) -> str | None:
    if code in (-signal.SIGALRM, -signal.SIGXCPU):
        return "endless"
    if code not in DOCUMENTED:
        return f"exit code {code}"
    if "Traceback" in said:
        return "traceback"
    if "\noutside: " in said:
        return "writes outside its folder"
    if "\nmemory: " in said:
        return "takes too much memory"
    if code in (2, 3, 4) and "error: " not in said and "Usage" not in said:
        return "no message"
    if any(len(line) > 3000 for line in said.splitlines()) and code:
        return "endless line"
    return None


def soak(first: int, cases: int, seconds: float) -> Iterator[Ended]:
    """Yield what comes of so many cases, or of those that the time is enough for."""
    until = time.monotonic() + seconds
    with TemporaryDirectory(prefix="mccd-soak-") as place:
        kit = Path(place) / "kit" / "work"
        make_kit(kit)
        known: dict[int, dict[str, str]] = {}
        for seed in range(first, first + cases):
            if time.monotonic() > until:
                return
            box = Path(place) / "box"
            box.mkdir()
            try:
                yield case(seed, kit, box, known)
            finally:
                shutil.rmtree(box, ignore_errors=True)
                if box.exists():  # a name that is too deep for the standard library
                    subprocess.run(["rm", "-rf", str(box)], check=True)


def main() -> int:
    """Run cases until the time is over; print each broken one, then counts by command and exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=0, metavar="SEED")
    parser.add_argument("--cases", type=int, default=10**9)
    parser.add_argument("--seconds", type=float, default=1e9)
    parser.add_argument("--verbose", action="store_true")
    options = parser.parse_args()
    from tests.running.server import load

    load()
    counts: dict[str, Counter[int]] = {}
    broken = 0
    for one in soak(options.first, options.cases, options.seconds):
        counts.setdefault(one.command, Counter())[one.code] += 1
        if options.verbose:
            print(one.code, one.shown, flush=True)
        if one.broken:
            broken += 1
            print(f"BROKEN {one.broken}\n", flush=True)
    for name, codes in sorted(counts.items()):
        print(f"{name:30} {sum(codes.values()):6}  {dict(sorted(codes.items()))}")
    print(f"{sum(c.total() for c in counts.values())} cases, {broken} broken")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
