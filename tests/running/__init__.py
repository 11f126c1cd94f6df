"""Running commands in tests: real processes, forked from one that has imported everything already.

Importing what a command needs takes longer than most commands do: a server (`server.py`) imports it once for all
workers of pytest and forks itself for every command. `mccd(...)` runs one to its end; `MCCD` and `PYTHON` are the first
words of a command line, for tests that start processes themselves and for scripts. A fork has its own streams, folder,
variables, signals and exit code. What it cannot show (imports, limits of the process, the start itself) is tested with
`REAL`, the interpreter.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from tests.running.direct import run_forked

REAL = (sys.executable, "-m", "mccdcli")
"""The command as users start it."""

# -I and -S: the client needs the standard library alone, and starts in a hundredth of a second
PYTHON = (sys.executable, "-I", "-S", str(Path(__file__).with_name("client.py")))
"""A forked interpreter: `-m MODULE` or `-c CODE` and arguments follow."""

MCCD = (*PYTHON, "-m", "mccdcli")
"""The command as a fork of the server."""

_COUNTING = "COVERAGE_PROCESS_"
"""How the variables begin by which coverage counts lines in every process (`make coverage`)."""

MEASURED = any(name.startswith(_COUNTING) for name in os.environ)


def unmeasured() -> dict[str, str]:
    """Return this process's variables for a new one that writes no counts of coverage: what it writes is watched."""
    return {name: value for name, value in os.environ.items() if not name.startswith(_COUNTING)}


def mccd(
    *arguments: str,
    cwd: Path | None = None,
    timeout: float = 180.0,
    env: Mapping[str, str] | None = None,
    command: Sequence[str] = MCCD,
) -> subprocess.CompletedProcess[str]:
    """Run `mccd ARGUMENTS` to its end and return what it printed; `env` comes on top of this process's variables."""
    words, environ = [*command, *arguments], os.environ | (env or {})
    if tuple(words[: len(PYTHON)]) == PYTHON:
        return run_forked(words[len(PYTHON) :], cwd=cwd, environ=environ, timeout=timeout)
    return subprocess.run(
        words,
        cwd=cwd,
        env=environ,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=timeout,
    )
