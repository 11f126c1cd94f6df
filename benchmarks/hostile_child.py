"""A hostile case in a process of its own, with limited memory and time, watched for what it writes elsewhere."""

from __future__ import annotations

import os
import resource
import signal
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks.hostile_cases import KERNELS

MEMORY_BYTES = 6_000_000_000
"""Of addresses, with which a case ends before it takes the memory of the machine."""

PEAK_BYTES = 2**30
"""What a case may hold in memory, those whom it starts included."""

LIMIT_S = 30
"""Processor time of a case; four times as long by the clock."""


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
        if (folder.parent / KERNELS).is_dir():
            os.environ["MCCD_KERNEL_CACHE"] = str(folder.parent / KERNELS)
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
