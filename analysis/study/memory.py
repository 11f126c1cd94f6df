"""The memory of trials: what one frees the next one takes, instead of the system's."""

from __future__ import annotations

import ctypes
from functools import cache

KEPT_BYTES = 64_000_000
LARGEST_BYTES = 16_000_000
"""What stays with the program at most when it is free, and up to which size an array is kept: larger ones are rare."""

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # the numbers of glibc's malloc.h


@cache
def keep_freed_memory() -> bool:
    """Let this process keep the memory that trials free; return False where the C library is none that can be told.

    Of what a settling trial gives back, the next one asks for 830 pages again, which the system fills with zeros: 2 of
    16 ms (benchmarks/results/study-shares-2026-11-21.json), more where MALLOC_TRIM_THRESHOLD_ is set, as dask sets it
    for its workers. No result depends on it.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError, TypeError):  # not glibc
        return False
    return bool(mallopt(_TRIM_THRESHOLD, KEPT_BYTES)) and bool(mallopt(_MMAP_THRESHOLD, LARGEST_BYTES))
