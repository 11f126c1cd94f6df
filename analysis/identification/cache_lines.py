"""Scratch memory of compiled fits: where it begins decides whether vectors lie across two lines of the cache."""

from __future__ import annotations

import numpy as np

from sim_backend.jit import njit
from sim_backend.linear import Array


@njit
def in_cache_lines(rows: int, columns: int) -> Array:
    """Return zeros (rows, columns) whose first number begins a line of 64 bytes.

    Rows of whole lines then hold every vector within one; otherwise chance decides whether a fit takes a third longer.
    """
    whole = np.zeros(rows * columns + 7)
    first = -(whole.ctypes.data // 8) % 8
    return whole[first : first + rows * columns].reshape(rows, columns)
