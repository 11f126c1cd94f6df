"""The memory of a process: what one step of a computation frees the next one takes, instead of the system's."""

from __future__ import annotations

import ctypes
from functools import cache

KEPT_BYTES, LARGEST_BYTES = 64_000_000, 16_000_000
"""Of a trial: what stays with the process at most when it is free, and up to which size an array is kept."""

_MOST_KEPT_BYTES, _MOST_LARGEST_BYTES = 2_000_000_000, 33_000_000
"""Of a diagnosis, whose arrays are long and come and go by the thousand; glibc keeps none beyond 32 MiB."""

_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8  # the numbers of glibc's malloc.h


@cache
def keep_freed_memory(
    kept_bytes: int = KEPT_BYTES, largest_bytes: int = LARGEST_BYTES, *, one_heap: bool = False
) -> bool:
    """Let this process keep memory that is free again; return False where the C library does not take this.

    Of what a settling trial gives back, the next one asks for 830 pages again, which the system fills with zeros: 2 of
    16 ms (benchmarks/results/study-shares-2026-11-21.json), more where MALLOC_TRIM_THRESHOLD_ is set, as dask sets it
    for its workers. With `one_heap` all threads begun from then on share what is free, which saves memory where they
    hold it in turn. No result depends on any of it.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError, TypeError):  # not glibc
        return False
    wanted = [(_TRIM_THRESHOLD, kept_bytes), (_MMAP_THRESHOLD, largest_bytes)] + [(_ARENA_MAX, 1)] * one_heap
    return all([bool(mallopt(which, value)) for which, value in wanted])


def keep_long_arrays() -> bool:
    """Let all threads of a diagnosis keep what they free; return False where the C library does not take this.

    Else a tenth of its time goes to the system, for the same pages again and again (docs/speed.md).
    """
    return keep_freed_memory(_MOST_KEPT_BYTES, _MOST_LARGEST_BYTES, one_heap=True)
