"""What decides a study's results, part by part: a study is gone on with only where every part is the same."""

from __future__ import annotations

import hashlib
import json
import os
import platform
from functools import cache
from typing import Any

import msgspec
import numpy as np
import scipy

from analysis.study.trial import Job
from campaigns.version import tool_version
from sim_backend.errors import ConfigError
from sim_backend.model import Model

BLAS = "threads of BLAS (OPENBLAS_NUM_THREADS)"
"""The name of that part, with what sets it."""


def blas_threads() -> str:
    """Return how many threads share one product of matrices, which decides in which order its terms are added.

    The library under numpy reads it from these variables, in this order, when it is first imported.
    """
    named = (os.environ.get(name) for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"))
    return next((value for value in named if value), f"one for each of {os.cpu_count()} cores")


@cache
def machine() -> str:
    """Return what the last digits of a result depend on besides the study: versions, and the kind of processor.

    Compiled code and the libraries under numpy choose their instructions by the processor.
    """
    import llvmlite.binding
    import numba

    return ", ".join(
        [
            f"mccd {tool_version()}",
            f"Python {platform.python_version()}",
            f"numpy {np.__version__}",
            f"scipy {scipy.__version__}",
            f"numba {numba.__version__}",
            f"llvmlite {llvmlite.__version__}",
            f"processor {llvmlite.binding.get_host_cpu_name()}",
        ]
    )


def decided(job: Job) -> list[Any]:
    """Return what the settings decide at every point of the grid; raises ConfigError for settings that cannot be."""
    return [job.kind.decides(job.undrawn(point)) for point in range(len(job.study.points))]


def fingerprint(job: Job) -> dict[str, str]:
    """Return the parts; raises ConfigError as `decided`.

    The number of draws, the title and the limits are no part of it: with more draws a study goes on.
    """
    study = job.study
    return {
        "kind": study.kind,
        "seed": str(study.seed),
        "models": _digest(job.models),
        "settings": _digest(study.settings),
        "what varies": _digest(msgspec.to_builtins(study.vary)),
        "files that the settings name": _digest(decided(job)),
        BLAS: blas_threads(),
        "machine": machine(),
    }


def require_same(expected: dict[str, str], found: dict[str, str], where: str, fix: str) -> None:
    """Raise ConfigError naming the first part that differs."""
    for part, value in expected.items():
        if found.get(part) != value:
            short = part in ("kind", "seed", BLAS, "machine")
            detail = f": {found.get(part)} instead of {value}" if short else ""
            raise ConfigError(f"{where}: not the same study in its {part}{detail}; {fix}")


def _digest(value: Any) -> str:
    text = json.dumps(value, sort_keys=True, default=_plain)
    return hashlib.sha256(text.encode()).hexdigest()


def _plain(value: object) -> object:
    if isinstance(value, Model):
        return msgspec.to_builtins(value)
    return repr(value)
