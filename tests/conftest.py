"""Settings of the whole suite."""

import gc
import os
import shutil
import sys
import tempfile
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import settings
from platformdirs import user_cache_path

from mccdcli.freed_memory import keep_freed_memory
from tests.running.client import OWNER, SOCKET
from tests.selection import COLLECTED, is_thorough

pytest_plugins = ["tests.order"]

# No deadline: a first call compiles. In continuous integration the same examples every time.
settings.register_profile("default", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "default")

# pytest-xdist already fills the cores with processes; see THREAD_VARIABLES in mccdcli/main.py for what threads cost.
# Nothing has imported numpy yet: it reads these once.
for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

keep_freed_memory()

# jsonschema compiles a grammar of international addresses, if one is installed, while it is imported: 2 s of every
# worker. No schema here has a format.
sys.modules.setdefault("rfc3987_syntax", None)  # type: ignore[arg-type]

# Compiled code and the list of fonts are those of whoever runs the tests, whatever home a test has.
# What is kept goes by the contents of the sources, so it is never out of date.
CACHE = user_cache_path("mccd", appauthor=False)
for name, folder in (("MCCD_KERNEL_CACHE", "kernels"), ("MPLCONFIGDIR", "matplotlib")):
    os.environ.setdefault(name, str(CACHE / folder))


def pytest_configure(config: pytest.Config) -> None:
    """Say where the server of commands listens, once it is started, and that it ends with this process."""
    if not hasattr(config, "workerinput"):
        os.environ[OWNER] = str(os.getpid())
        # a socket's path has to be short, and a temporary folder of pytest's may be long
        os.environ[SOCKET] = str(Path(tempfile.mkdtemp(prefix="mccd-")) / "s")


def pytest_unconfigure(config: pytest.Config) -> None:
    """Remove the folder of the server's socket."""
    if not hasattr(config, "workerinput"):
        shutil.rmtree(Path(os.environ[SOCKET]).parent, ignore_errors=True)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Look for no garbage among what is imported and collected, now or later: it stays, and each search takes 1 s."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(tryfirst=True)  # before pytest leaves out what its option -m says
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark what only `make test-all` runs."""
    config.stash[COLLECTED] = [item.nodeid for item in items]
    for item in items:
        if is_thorough(item.nodeid):
            item.add_marker(pytest.mark.thorough)
