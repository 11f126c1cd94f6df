"""Feed every command with hostile options, words and files, and count what comes of it.

    python -m benchmarks.soak_hostile --seconds 3600

Each case is a process of its own, forked from one that has imported everything, in a copy of a folder of small sound
files, with limited memory and time. It must end with an exit code that is documented, never with 70, without a
traceback, and touch nothing outside its folder. Exit code 1 if a single case breaks a promise.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from platformdirs import user_cache_path

from benchmarks.hostile_cases import BASES, drawn
from mccdcli.main import main as mccd

DOCUMENTED = {0, 1, 2, 3, 4, 130, 141}
MEMORY_BYTES = 6_000_000_000
"""Of addresses, with which a case ends before it takes the memory of the machine."""

PEAK_BYTES = 2**30
"""What a case may hold in memory, those whom it starts included."""

LIMIT_S = 30
"""Processor time of a case; four times as long by the clock."""

SERVED_S = 5.0
"""After which what goes on until it is told is told to stop: a bench that is served, a log that is waited for."""

LONG = 10
"""By how much more time `challenge make` has: a case of every family left out is minutes of honest work."""

STUDY = """schema = "mccd-study/1"
name = "tiny"
kind = "endstops"
trials = 2
seed = 1
settings = { ramp_s = 0.02, settle_s = 0.02, hold_s = 0.05 }
limits = { noise_3sigma_m = 4e-8 }
[[vary]]
place = "model.modes[*].frequency_hz"
relative = true
normal = { std = 0.002 }
[[vary]]
place = "settings.current_a"
sweep = [ 4.0, 6.0 ]
"""
CAMPAIGN = """name = "small"
title = "a small one"
[[runs]]
name = "rest"
plan = "rest"
settings = { duration_s = 0.1, settle_s = 0.05 }
[[runs]]
name = "chop"
plan = "chop"
settings = { cycles = 2, frequency_hz = 5.0, window_s = 0.05, strategy = "mbff" }
"""
MAP = """[log]
test = "free-run"
source = "data.csv"
sample_rate_hz = 10.0
[channels.x]
select = "x"
unit = "mrad"
role = "output"
dof = "z"
[channels.u]
select = "u"
unit = "N"
role = "input"
dof = "z"
[segments]
"held-out" = [ 5, 20 ]
"""
SOUND: tuple[tuple[str, ...], ...] = (
    ("simulate", "--plan", "rest", "--set", "duration_s=0.2", "--set", "settle_s=0.1", "-o", "rest.h5"),
    ("simulate", "--model", "design", "--plan", "multisine", "--set", "period_s=0.05", "--set", "start_hz=20", "--set",
     "realisations=1", "-o", "run.h5"),
    ("model", "convert", "as-built", "-o", "model.toml"),
    ("model", "convert", "design-4th-order", "-o", "nominal.toml"),
    ("campaign", "run", "campaign.toml", "-o", "played"),
    ("study", "study.toml", "-o", "studied", "--workers", "1"),
    ("challenge", "make", "hidden", "--one", "0", "--none", "1", "--shape", "short"),
)  # fmt: skip
"""What makes the sound files."""


def make_kit(folder: Path) -> None:
    """Fill a folder with small sound files of every kind that commands read, and some that are none."""
    # compiled code and the list of fonts are those of whoever runs this, whatever home a case has
    for name, kept in (("MCCD_KERNEL_CACHE", "kernels"), ("MPLCONFIGDIR", "matplotlib")):
        os.environ.setdefault(name, str(user_cache_path("mccd", appauthor=False) / kept))
    folder.mkdir()
    for name, text in (("study.toml", STUDY), ("campaign.toml", CAMPAIGN), ("map.toml", MAP)):
        (folder / name).write_text(text, encoding="utf-8")
    rows = "".join(f"{0.1 * i:.1f},{i % 7},{i % 5 - 2}\n" for i in range(40))
    (folder / "data.csv").write_text("t,x,u\n" + rows, encoding="utf-8")
    (folder / "wave.csv").write_text("theta_x,z\n" + "0.001,0.0\n0.0,0.01\n" * 50, encoding="utf-8")
    (folder / "readings.csv").write_text("theta_x,theta_y\n" + "0.001,0.0\n" * 13, encoding="utf-8")
    curve = "".join(f"{10 * i},{1 / (1 + i * i)},{-3 * i}\n" for i in range(1, 30))
    (folder / "response.csv").write_text("frequency_hz,magnitude,phase_deg\n" + curve, encoding="utf-8")
    u, x = np.arange(40) % 5 - 2.0, np.arange(40) % 7 / 7.0
    np.savez(folder / "data.npz", u=u, x=x)
    np.save(folder / "data.npy", np.stack([u, x], axis=1))
    (folder / "map-npz.toml").write_text(MAP.replace("data.csv", "data.npz"), encoding="utf-8")
    columns = MAP.replace("data.csv", "data.npy").replace('"x"\nunit', '"[:, 1]"\nunit').replace('"u"\n', '"[:, 0]"\n')
    (folder / "map-npy.toml").write_text(columns, encoding="utf-8")
    for arguments in SOUND:
        code, said = in_child(lambda words=arguments: mccd(list(words)), folder, LIMIT_S)
        if code:
            raise RuntimeError(f"{' '.join(arguments)} ends with {code}: {said}")
    results = folder / "hidden" / "results" / "0001"
    results.mkdir(parents=True)
    ended = {"case": "0001", "exit_code": 0, "wall_s": 1.0, "cpu_s": 1.0, "tool_version": "1", "tool_commit": "a"}
    (results / "run.json").write_text(json.dumps(ended), encoding="utf-8")
    cause = {"effect": "backlash", "where": "theta_x", "probability": 0.9, "parameters": {"gap": {"value": 1.0}}}
    said = {"verdict": "named", "causes": [cause], "ambiguous": [], "gain": {"rms_after": 1.0}, "remainder": None}
    (results / "diagnosis.json").write_text(json.dumps(said), encoding="utf-8")
    in_child(lambda: mccd(["challenge", "score", "hidden", "-o", "score.json"]), folder, LIMIT_S)
    (folder / "folder").mkdir()
    (folder / "empty").touch()
    (folder / "binary").write_bytes(bytes(range(256)) * 20)
    (folder / "long").write_bytes(b"x" * 1_000_000)
    (folder / "deep").write_bytes(b"a = " + b"[" * 100_000)
    (folder / "link").symlink_to("nowhere")
    (folder / "loop").symlink_to("loop")
    (folder / "unreadable").touch(mode=0)


def in_child(
    do: Callable[[], object],
    folder: Path,
    limit_s: int,
    watched: Sequence[Path] = (),
    stop_s: float | None = None,
) -> tuple[int, str]:
    """Do something in a fork of this process, in a folder; return its exit code, negative for a signal, and its words.

    It is told to stop (SIGTERM) after `stop_s`. What it opens for writing outside of `watched` (`_tell_of_writes`) is
    said in a line that begins with "outside:", a peak of memory above the limit in one that begins with "memory:".
    """
    with open(folder.parent / "said", "w+b") as said:
        pid = os.fork()
        if pid == 0:
            _child(do, folder, limit_s, watched, stop_s, said.fileno())
        _, status, used = os.wait4(pid, 0)
        said.seek(0)
        words = said.read(1_000_000).decode("utf-8", "replace")
        peak = used.ru_maxrss * (1 if sys.platform == "darwin" else 1024)
        return os.waitstatus_to_exitcode(status), words + (f"\nmemory: {peak} bytes" if peak > PEAK_BYTES else "")


def _child(
    do: Callable[[], object], folder: Path, limit_s: int, watched: Sequence[Path], stop_s: float | None, said: int
) -> None:
    code = 99
    try:
        os.setsid()
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(said, 1)
        os.dup2(said, 2)
        os.chdir(folder)
        # the standard streams are those that the process began with; what they hold is written below
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)
        sys.stderr = open(2, "w", encoding="utf-8", closefd=False, errors="backslashreplace")
        os.environ |= {"HOME": str(folder.parent / "home"), "TMPDIR": str(folder.parent / "tmp")}
        for name in [name for name in os.environ if name.startswith("XDG_")]:
            del os.environ[name]
        tempfile.tempdir = None  # of this process, which may have asked for it before
        if stop_s is not None:
            stop = threading.Timer(stop_s, os.kill, (os.getpid(), signal.SIGTERM))
            stop.daemon = True
            stop.start()
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s + 1))
        signal.alarm(4 * limit_s)
        if watched:
            _tell_of_writes(watched)
        found = do()
        code = found if isinstance(found, int) else 0
        sys.stdout.flush()
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)


_OPENED = (
    "open",
    "os.remove",
    "os.rename",
    "os.mkdir",
    "os.rmdir",
    "os.link",
    "os.symlink",
    "os.truncate",
    "sqlite3.connect",
)
_CHANGES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC


def _tell_of_writes(watched: Sequence[Path]) -> None:
    """Tell of what is changed outside the first folder, what lies in it or below, or right in one of the others."""
    named = {str(folder) for folder in watched[1:]}
    kept = (
        str(watched[0]),
        os.environ.get("MCCD_KERNEL_CACHE", "-"),
        os.environ.get("MPLCONFIGDIR", "-"),
        "/dev/",
        "/proc/self/",
    )

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        if event not in _OPENED or (
            event == "open" and not (isinstance(arguments[2], int) and arguments[2] & _CHANGES)
        ):
            return
        for name in arguments[:2] if event in ("os.rename", "os.link", "os.symlink") else arguments[:1]:
            if not isinstance(name, str | bytes | os.PathLike):
                continue
            path = os.path.abspath(os.fsdecode(name))
            if os.path.dirname(path) in named:
                continue
            if not f"{path}/".startswith(kept) and os.path.isdir(os.path.dirname(path)):
                os.write(2, f"\noutside: {event} {path!r}\n".encode("utf-8", "backslashreplace"))

    sys.addaudithook(hook)


def case(seed: int, kit: Path, box: Path) -> tuple[str, int, str | None, str]:
    """Carry out a case in the empty folder `box`; return its command, its exit code, what is broken, and its words."""
    work = box / "work"
    shutil.copytree(kit, work, symlinks=True)
    for name in ("home", "tmp"):
        (box / name).mkdir()
    here = os.getcwd()
    os.chdir(work)
    try:
        arguments, changes, told = drawn(seed)
        for change in changes:
            change()
    finally:
        os.chdir(here)
    began = time.monotonic()
    waits = "--wait" in arguments
    stop_s = SERVED_S if arguments[:2] == ["bench", "serve"] or waits else None
    limit_s = LIMIT_S * (LONG if arguments[:2] == ["challenge", "make"] else 1)
    # whoever names a folder outside gets what was asked for there, and nothing deeper
    named = {Path(a): set(os.listdir(a)) for a in arguments if a.startswith("/") and os.path.isdir(a)}
    code, said = in_child(lambda: mccd(arguments), work, limit_s, watched=[box, *named], stop_s=stop_s)
    for folder, before in named.items():
        for left in set(os.listdir(folder)) - before:
            if (folder / left).is_file():
                (folder / left).unlink()
    name = " ".join(BASES[seed % len(BASES)][:2])
    shown = (
        f"seed {seed}: mccd {' '.join(a[:60] for a in arguments)!r} ({told[:300]}; {time.monotonic() - began:.1f} s)"
    )
    # what only waits has nothing to make safe, and may end by the signal itself
    broken = _broken(0 if waits and code == -signal.SIGTERM else code, said)
    return name, code, broken and f"{broken}: {shown}: {said[-600:]}", shown


def _broken(code: int, said: str) -> str | None:
    if code in (-signal.SIGALRM, -signal.SIGXCPU):
        return "endless"
    if code not in DOCUMENTED:
        return f"exit code {code}"
    if "Traceback" in said:
        return "traceback"
    if "outside:" in said:
        return "writes outside its folder"
    if "\nmemory: " in said:
        return "takes too much memory"
    if code in (2, 3, 4) and "error: " not in said and "Usage" not in said:
        return "no message"
    if any(len(line) > 3000 for line in said.splitlines()) and code:
        return "endless line"
    return None


def soak(first: int, cases: int, seconds: float) -> Iterator[tuple[str, int, str | None, str]]:
    """Yield what comes of so many cases, or of those that the time is enough for."""
    until = time.monotonic() + seconds
    with TemporaryDirectory(prefix="mccd-soak-") as place:
        kit = Path(place) / "kit" / "work"
        kit.parent.mkdir()
        (kit.parent / "tmp").mkdir()
        make_kit(kit)
        for seed in range(first, first + cases):
            if time.monotonic() > until:
                return
            box = Path(place) / "box"
            box.mkdir()
            try:
                yield case(seed, kit, box)
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
    for name, code, what, shown in soak(options.first, options.cases, options.seconds):
        counts.setdefault(name, Counter())[code] += 1
        if options.verbose:
            print(code, shown, flush=True)
        if what:
            broken += 1
            print(f"BROKEN {what}\n", flush=True)
    for name, codes in sorted(counts.items()):
        print(f"{name:30} {sum(codes.values()):6}  {dict(sorted(codes.items()))}")
    print(f"{sum(c.total() for c in counts.values())} cases, {broken} broken")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
