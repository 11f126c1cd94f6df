"""What a result was measured with: the sources, the machine, the versions, and what else the machine was doing."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
from pathlib import Path
from typing import Any

from benchmarks.speed.base import version_of
from campaigns.version import tool_commit, tool_version

VERSIONS = ("numpy", "scipy", "numba", "llvmlite", "control", "h5py", "scikit-rf")
UNKNOWN = "unknown"


def sources() -> dict[str, Any]:
    """Return version and commit of mccd; `dirty` is None where there is no checkout to ask."""
    commit = tool_commit()
    known = commit != UNKNOWN
    dirty = commit.endswith("-dirty") if known else None
    return {"version": tool_version(), "commit": commit.removesuffix("-dirty"), "dirty": dirty}


def doubt(told: dict[str, Any]) -> str | None:
    """Return why nobody can fetch the `sources` that were measured, None if they are a commit as it stands."""
    if told["dirty"] is None:
        return "the commit is unknown: these are not the sources of a checkout"
    return "the sources differ from the commit: the tree was dirty" if told["dirty"] else None


def machine() -> dict[str, Any]:
    """Return what the times were taken on; what is not there is `absent`."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        processor = next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        processor = platform.processor() or platform.machine()
    return {
        "processor": processor,
        "cores": os.cpu_count(),
        "cores_usable": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "gcc": compiler(),
        **{name: version_of(name) for name in VERSIONS},
    }


def compiler() -> str:
    """Return the version of gcc, `absent` if there is none."""
    if shutil.which("gcc") is None:
        return "absent"
    asked = ["gcc", "-dumpfullversion", "-dumpversion"]
    done = subprocess.run(asked, capture_output=True, text=True, timeout=10, check=False)
    return done.stdout.strip() or UNKNOWN


def load() -> list[float] | None:
    """Return how many processes ran or waited on average over 1, 5 and 15 minutes, None where nobody tells."""
    try:
        return [round(value, 2) for value in os.getloadavg()]
    except (AttributeError, OSError):
        return None
