"""A MATLAB file of version 5, written piece by piece: its numbers need not be in memory at once.

Source: "MAT-File Format", The MathWorks, the chapter on level 5. Every matrix has its size in bytes in front, which is
filled in when the matrix is written.
"""

from __future__ import annotations

import os
import struct
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import BinaryIO, TypeAlias

import numpy as np
from numpy.typing import NDArray

_INT8, _INT32, _UINT32, _DOUBLE, _MATRIX, _UTF8 = 1, 5, 6, 9, 14, 16
"""Kinds of data elements."""
_CELL_CLASS, _STRUCT_CLASS, _CHAR_CLASS, _DOUBLE_CLASS = 1, 2, 4, 6
"""Classes of matrices."""


@dataclass(frozen=True)
class Numbers:
    """A column of numbers, or an empty matrix: its shape, and its values in `blocks` (k,) that are read once."""

    shape: tuple[int, int]
    blocks: Iterable[NDArray[np.float64]]


Value: TypeAlias = "str | Numbers | Sequence[str] | Mapping[str, Value]"
"""A text, a column, a column of texts (a cell array), or a structure."""


def write_structure(file: BinaryIO, name: str, fields: Mapping[str, Value]) -> None:
    """Write the header and one structure `name` into an empty file that can be written at any position.

    Names of fields are ASCII, 63 characters at most.
    """
    about = f"MATLAB 5.0 MAT-file Platform: {os.name}, Created on: {time.asctime()}"
    file.write(struct.pack("<116s8xH2s", about.encode("ascii"), 0x0100, b"IM"))
    _write(file, fields, name)


def _write(file: BinaryIO, value: Value, name: str = "") -> None:
    """Write a value as a matrix; only the outermost has a name."""
    if isinstance(value, str):
        with _matrix(file, _CHAR_CLASS, (1, len(value)) if value else (0, 0), name):
            _element(file, _UTF8, value.encode("utf-8"))
    elif isinstance(value, Numbers):
        with _matrix(file, _DOUBLE_CLASS, value.shape, name):
            _numbers(file, value)
    elif isinstance(value, Mapping):
        width = max(map(len, value)) + 1
        with _matrix(file, _STRUCT_CLASS, (1, 1), name):
            _element(file, _INT32, struct.pack("<i", width))
            _element(file, _INT8, b"".join(field.encode("ascii").ljust(width, b"\0") for field in value))
            for inner in value.values():
                _write(file, inner)
    else:
        with _matrix(file, _CELL_CLASS, (len(value), 1) if value else (0, 0), name):
            for inner in value:
                _write(file, inner)


@contextmanager
def _matrix(file: BinaryIO, kind: int, shape: tuple[int, int], name: str) -> Iterator[None]:
    """Write the head of a matrix, then what the caller writes, then the size of both into the head."""
    start = file.tell()
    file.write(struct.pack("<II", _MATRIX, 0))
    file.write(struct.pack("<IIII", _UINT32, 8, kind, 0))
    _element(file, _INT32, struct.pack("<ii", *shape))
    _element(file, _INT8, name.encode("ascii"))
    yield
    stop = file.tell()
    file.seek(start + 4)
    file.write(struct.pack("<I", stop - start - 8))
    file.seek(stop)


def _element(file: BinaryIO, kind: int, data: bytes) -> None:
    """Write a data element; up to four bytes are in its tag, more are filled up to a multiple of eight."""
    if len(data) <= 4:
        file.write(struct.pack("<HH4s", kind, len(data), data))
    else:
        file.write(struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8))


def _numbers(file: BinaryIO, column: Numbers) -> None:
    """Write the values of a column as one data element."""
    size = 8 * column.shape[0] * column.shape[1]
    if size == 0:
        _element(file, _DOUBLE, b"")
        return
    file.write(struct.pack("<II", _DOUBLE, size))
    for block in column.blocks:
        file.write(block.astype("<f8").tobytes())
