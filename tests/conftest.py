"""Settings of the whole suite."""

import os
from pathlib import Path

from hypothesis import settings

# No deadline: a first call compiles. In continuous integration the same examples every time.
settings.register_profile("default", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "default")

# pytest-xdist already fills the cores with processes; see THREAD_VARIABLES in mccdcli/main.py for what threads cost.
# Nothing has imported numpy yet: it reads these once.
for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

# Processes that fill one cold cache of numba at a time may overwrite each other's code, so each worker of
# pytest-xdist, and what it starts, has its own. This must stand here: numba reads it when it is first imported.
if worker := os.environ.get("PYTEST_XDIST_WORKER"):
    os.environ["NUMBA_CACHE_DIR"] = str(Path(__file__).parents[1] / ".pytest_cache" / "numba" / worker)
