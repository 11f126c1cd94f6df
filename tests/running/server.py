"""The server: imports everything that commands need, then forks itself for each command that a client hands over.

It has no threads and runs no command itself, so a fork starts as a new process would. It ends with the process that it
is told to end with; a command is killed when its client goes away.
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import importlib
import io
import json
import os
import pkgutil
import runpy
import selectors
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Callable
from types import ModuleType
from typing import Any, NoReturn

PACKAGES = ("sim_backend", "campaigns", "analysis", "mccd", "mccdcli")
LIBRARIES = ("control", "h5py", "jinja2", "matplotlib.pyplot", "numba", "pandas", "rich.progress", "serial")
PARTS_OF_SCIPY = ("fft", "interpolate", "io", "linalg", "ndimage", "optimize", "signal", "sparse", "stats")
TAKES_S = 20.0  # a client that is stopped while it hands its words over holds the others up no longer


def main(path: str, owner: int) -> None:
    """Serve at a socket until process `owner` ends."""
    end_of_owner = os.pidfd_open(owner)
    load()
    watched = selectors.DefaultSelector()
    with socket.socket(socket.AF_UNIX) as listening:
        # whoever sees the socket may connect at once
        listening.bind(f"{path}.new")
        listening.listen(64)
        os.rename(f"{path}.new", path)
        watched.register(end_of_owner, selectors.EVENT_READ, lambda: sys.exit(0))
        watched.register(listening, selectors.EVENT_READ, lambda: accept(listening, watched))
        print("ready", flush=True)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        while True:
            key, _ = watched.select()[0]  # one at a time: its answer may end what the next one is about
            key.data()


def load() -> None:
    """Import all modules of the project and the libraries that it uses."""
    for name in (*LIBRARIES, *(f"scipy.{part}" for part in PARTS_OF_SCIPY)):
        importlib.import_module(name)
    for package in PACKAGES:
        for info in pkgutil.walk_packages(importlib.import_module(package).__path__, f"{package}."):
            if not info.name.endswith("__main__"):
                importlib.import_module(info.name)
    gc.freeze()  # no fork looks for garbage among it, nor copies it by looking


def accept(listening: socket.socket, watched: selectors.BaseSelector) -> None:
    """Take a command from a client and start it; a client that has gone meanwhile is forgotten."""
    connection, _ = listening.accept()
    connection.settimeout(TAKES_S)
    streams: list[int] = []
    try:
        head, streams, _, _ = socket.recv_fds(connection, 8, 3)
        words = received(connection, int.from_bytes(head, "big"))
        pid = os.fork()
        if pid == 0:
            run(json.loads(words), streams)
    except OSError:
        connection.close()
        return
    finally:
        for stream in streams:
            os.close(stream)
    ended = os.pidfd_open(pid)

    def forget() -> None:
        for what in (connection, ended):
            watched.unregister(what)
        connection.close()
        os.close(ended)

    def tell_its_end() -> None:
        _, status = os.waitpid(pid, 0)
        tell(connection, os.waitstatus_to_exitcode(status))
        forget()

    def end_it() -> None:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        forget()

    tell(connection, pid)
    watched.register(ended, selectors.EVENT_READ, tell_its_end)
    watched.register(connection, selectors.EVENT_READ, end_it)  # a client sends nothing more: its end is all we hear


def received(connection: socket.socket, size: int) -> bytes:
    """Return so many bytes of a client's; ConnectionError where it has gone before."""
    words = b""
    while len(words) < size or not size:
        part = connection.recv(size - len(words))
        if not part:
            raise ConnectionError("the client has gone")
        words += part
    return words


def tell(connection: socket.socket, number: int) -> None:
    """Send a client a number; one that has gone is heard of as its connection's end."""
    with contextlib.suppress(OSError):
        connection.sendall(b"%d\n" % number)


def run(words: dict[str, Any], streams: list[int]) -> NoReturn:
    """Be the command: in a process of its own, with a client's words, folder, variables and streams."""
    code = 70
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        for number, stream in enumerate(streams):
            os.dup2(stream, number)
        os.closerange(3, 1024)
        os.environ.clear()
        os.environ.update(words["environ"])
        os.chdir(words["cwd"])
        sys.stdin, sys.stdout, sys.stderr = _stream(0, "r"), _stream(1, "w"), _stream(2, "w")
        sys.__stdin__, sys.__stdout__, sys.__stderr__ = sys.stdin, sys.stdout, sys.stderr  # type: ignore[misc]  # final
        code = ended_with(program(words["arguments"]))
    finally:
        if code == -signal.SIGINT:  # the interpreter ends so, for its caller to see
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            os.kill(os.getpid(), signal.SIGINT)
        os._exit(code)


def program(words: list[str]) -> Callable[[], object]:
    """Return what the interpreter would run for the words `-m MODULE …` or `-c CODE …`."""
    kind, what, *arguments = words
    sys.argv = [kind if kind == "-c" else what, *arguments]
    sys.path[0] = os.getcwd()
    if kind == "-m":
        return lambda: runpy.run_module(what, run_name="__main__", alter_sys=True)
    main = ModuleType("__main__")
    sys.modules["__main__"] = main
    return lambda: exec(compile(what, "<string>", "exec"), main.__dict__)


def ended_with(run_program: Callable[[], object]) -> int:
    """Return the exit code of a program, after all that is done at a process's end."""
    code = 0
    try:
        run_program()
    except SystemExit as error:
        if isinstance(error.code, str):
            print(error.code, file=sys.stderr)
        code = error.code if isinstance(error.code, int) else int(error.code is not None)
    except KeyboardInterrupt:
        traceback.print_exc()
        code = -signal.SIGINT
    except BaseException:
        traceback.print_exc()
        code = 1
    threading._shutdown()  # type: ignore[attr-defined]  # noqa: SLF001 waits for threads, as the interpreter does
    atexit._run_exitfuncs()  # noqa: SLF001
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            code = code or 120  # as the interpreter says it
    return code


def _stream(number: int, mode: str) -> io.TextIOWrapper:
    """Return a standard stream as the interpreter opens it."""
    raw = open(number, f"{mode}b", buffering=-1, closefd=False)
    encoding, _, errors = os.environ.get("PYTHONIOENCODING", "utf-8").partition(":")
    errors = "backslashreplace" if number == 2 else errors or "strict"
    return io.TextIOWrapper(raw, encoding=encoding, errors=errors, line_buffering=number == 2 or os.isatty(number))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
