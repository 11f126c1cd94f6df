"""An array that is handed on piece by piece, so that whoever reads it holds a piece and never the whole."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

PIECE_BYTES = 32 * 2**20

Box = tuple[slice | int, ...]


@dataclass(frozen=True)
class Pieces:
    """An array of `shape` and `dtype` whose numbers `read` gives in C order, anew at each call.

    `turned` says that the array meant is the transpose.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    read: Callable[[], Iterator[NDArray[Any]]]
    turned: bool = False

    @property
    def nbytes(self) -> int:
        """Bytes of the whole."""
        return math.prod(self.shape) * self.dtype.itemsize


def of_array(values: NDArray[Any]) -> Pieces:
    """Return an array of any shape that is held whole already as one piece; one in Fortran's order is not copied."""
    turned = not values.flags.c_contiguous and values.T.flags.c_contiguous
    plain = np.ascontiguousarray(values.T if turned else values)
    return Pieces(plain.shape, plain.dtype, lambda: iter([plain]), turned)


def boxes(shape: tuple[int, ...], itemsize: int, chunks: tuple[int, ...] | None = None) -> Iterator[Box]:
    """Yield what to select for pieces of at most PIECE_BYTES, in C order, along `chunks` where these are smaller."""
    if not shape or 0 in shape:
        if not shape:
            yield ()
        return
    axis = next((k for k in range(len(shape)) if itemsize * math.prod(shape[k + 1 :]) <= PIECE_BYTES), len(shape) - 1)
    rows = max(PIECE_BYTES // (itemsize * math.prod(shape[axis + 1 :])), 1)
    if chunks is not None and rows >= chunks[axis]:
        rows = rows // chunks[axis] * chunks[axis]
    for above in np.ndindex(shape[:axis]):
        for first in range(0, shape[axis], rows):
            yield (*above, slice(first, first + rows))
