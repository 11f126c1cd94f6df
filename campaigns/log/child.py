"""A Python process of our own with bounded memory and time, for what may crash, hang or exhaust whoever reads it."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

from campaigns.log.limits import READER_BYTES
from sim_backend.errors import DataError

START_S = 120.0
"""A cold disk or a busy machine needs long to start Python and import a library; that is not a fault of the file."""

LEAST_S = 15.0
SLOWEST_BYTES_S = 2e6
"""Of a log with thousands of channels and few samples, which takes longest for its size."""

WAIT_S = 120.0
WAITS = 10.0
"""A reader may take so many times its processor time, and so much more, until it counts as blocked: by a disk that does
not answer, or by a machine that has others to serve."""


def start_python(code: str, *arguments: str, talk: bool = False) -> subprocess.Popen[bytes]:
    """Start `code` with this package on its path; its standard output is a pipe, its input too where we `talk`."""
    root = str(Path(__file__).resolve().parents[2])
    search = os.pathsep.join([root, os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    return subprocess.Popen(
        [sys.executable, "-P", "-c", code, *arguments],
        stdin=subprocess.PIPE if talk else subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": search},
    )


def may_fork() -> bool:
    """Tell whether a copy of this process can do a child's work: it has one thread, on a system that is known for it.

    A lock that another thread holds would stay locked in a copy for good.
    """
    return sys.platform == "linux" and threading.active_count() == 1


def fork_python(work: Callable[[], None]) -> subprocess.Popen[bytes]:
    """Do `work` in a copy of this process that talks as a child of `start_python` does, in a tenth of the time.

    It keeps no file of this process open, and ends without what this process would do at its end.
    """

    def run() -> None:
        status = 1
        try:
            os.closerange(3, resource.getrlimit(resource.RLIMIT_NOFILE)[0])  # among them what Popen waits for
            sys.stdin, sys.stdout = open(0, closefd=False), open(1, "w", closefd=False)
            work()
            sys.stdout.flush()
            status = 0
        finally:
            os._exit(status)

    import resource

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of threads that libraries keep for their sums
        return subprocess.Popen(
            [sys.executable],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            preexec_fn=run,  # which never returns
        )


class ReaderFailedError(DataError):
    """A reader did not start, was kept waiting or had too little memory; the file is not known to be at fault."""


class Limited:
    """Holds a child that reads for us to its limits, and tells why it ended where it did not keep them."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self.process = process
        self.ready = False
        self._limit_s, self._wait_s = 0.0, 0.0
        self._late = threading.Event()

    def await_ready(self, path: Path) -> None:
        """Wait until the child has started, to read the file at `path`; raises DataError when it does not in time."""
        if not self.ready:
            await_ready(self.process, path)
            self.ready = True

    @contextlib.contextmanager
    def within(self, limit_s: float) -> Iterator[None]:
        """Let the child take so many seconds of a processor for what is asked of it inside the block."""
        self._limit_s, self._wait_s = limit_s, WAIT_S + WAITS * limit_s
        _bound_processor_time(self.process, limit_s)
        with _timer(self._wait_s, self._end):
            yield

    def why(self, path: Path) -> DataError:
        """Return the error for a child that has not answered about the file at `path`."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(1.0)
        if self._late.is_set():
            return ReaderFailedError(
                f"reading {path} took too long: its reader had not ended after {self._wait_s:.0f} s; the machine or "
                "its disk may be busy, try again"
            )
        if self.process.returncode == -getattr(signal, "SIGXCPU", 0):
            what = f"keeps its reader busy for more than {self._limit_s:.0f} s of processor time"
        else:
            what = f"crashes its reader (exit {self.process.returncode})"
        return DataError(f"{path} is damaged and {what}: restore it from a copy")

    def close(self) -> None:
        """End the child."""
        self.process.kill()
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()
        self.process.wait()

    def _end(self) -> None:
        self._late.set()
        self.process.kill()


@contextlib.contextmanager
def _timer(after_s: float, act: Callable[[], object]) -> Iterator[threading.Timer]:
    """Let `act` be called after so many seconds, unless the block ends before.

    Ctrl-C may come before the block is entered, and the timer then runs on: as a daemon it keeps no process from
    ending.
    """
    timer = threading.Timer(after_s, act)
    timer.daemon = True
    try:
        timer.start()
        yield timer
    finally:
        timer.cancel()


def tell_ready() -> None:
    """Say in a child, as its first line, that it has started: from then on the time that its file takes counts."""
    sys.stdout.buffer.write(b"ready\n")
    sys.stdout.buffer.flush()


def await_ready(process: subprocess.Popen[bytes], path: Path) -> None:
    """Wait until a child has started that reads the file at `path`; raises DataError when it does not in time."""
    assert process.stdout is not None  # start_python makes it a pipe
    with _timer(START_S, process.kill) as timer:
        if process.stdout.readline() == b"ready\n":
            return
    process.wait()
    why = f"within {START_S:.0f} s" if timer.finished.is_set() and process.returncode < 0 else "as it should"
    raise ReaderFailedError(
        f"the process that reads {path} did not start {why} (exit {process.returncode}); the file is not at fault: "
        "try again when the machine is less busy"
    )


def time_limit_s(path: Path) -> float:
    """Return the processor time that a child may take to read the file at `path`; raises OSError without one.

    Holes in a file take no time to read.
    """
    from campaigns.log.guard import stored_bytes  # brings h5py, which only those who read files need

    return LEAST_S + stored_bytes(path) / SLOWEST_BYTES_S


def bound_memory(more_bytes: int = 0) -> None:
    """Let this process take READER_BYTES and `more_bytes` beyond what it has now; it leaves no core file either."""
    try:
        import resource

        mapped = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
        most = resource.getrlimit(resource.RLIMIT_AS)[1]
        resource.setrlimit(resource.RLIMIT_AS, (mapped + READER_BYTES + more_bytes, most))
    except (ImportError, OSError, ValueError):
        return  # not Linux, or a tighter limit stands already


def _bound_processor_time(process: subprocess.Popen[bytes], more_s: float) -> None:
    """Let the system end the process when it has computed for `more_s` from now on, however long that takes."""
    try:
        import resource

        with open(f"/proc/{process.pid}/stat", encoding="ascii", errors="replace") as file:
            fields = file.read().rpartition(")")[2].split()
        used_s = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")  # of the user and of the system
        most = resource.prlimit(process.pid, resource.RLIMIT_CPU)[1]
        resource.prlimit(process.pid, resource.RLIMIT_CPU, (math.ceil(used_s + more_s), most))
    except (ImportError, AttributeError, OSError, ValueError, IndexError):
        return  # not Linux, a tighter limit stands already, or it has ended: the clock on the wall counts
