"""Keep the memory that arrays free, instead of giving it back and being given it anew, page by page."""

from __future__ import annotations

import os
import sys
from typing import Final

# malloc.h of the GNU C library
TRIM_THRESHOLD: Final = -1
MMAP_THRESHOLD: Final = -3

OF_THE_USER: Final = ("MALLOC_MMAP_THRESHOLD_", "MALLOC_TRIM_THRESHOLD_", "GLIBC_TUNABLES")
"""What the library itself reads at its start; where the user sets one of them, it stands."""

KEPT_BYTES: Final = 1 << 30


def keep_freed_memory() -> bool:
    """Let this process keep up to 1 GiB of freed memory; return whether its C library does so.

    By default each array above 128 KiB to 32 MiB is mapped from the kernel and goes back to it when freed; the next one
    is filled with zeros page by page. A report met 3.1 million such pages, a quarter of its processor time; kept, 0.2
    million, with a quarter more memory at its peak. Source: mallopt(3).
    """
    if sys.platform != "linux" or any(name in os.environ for name in OF_THE_USER):
        return False
    import ctypes

    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # musl has none
    if mallopt is None:
        return False
    return all(mallopt(what, KEPT_BYTES) == 1 for what in (MMAP_THRESHOLD, TRIM_THRESHOLD))
