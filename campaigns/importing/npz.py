"""Numpy's own files, read as a stream: no size that a file tells of itself is believed.

Only the process of `foreign` reads them, whose memory and time are bounded: an archive may list millions of members.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from campaigns.importing.pieces import PIECE_BYTES, Pieces
from campaigns.importing.refusals import check_expansion, unreadable
from campaigns.log.guard import refuse, stored_bytes

_ERRORS = (
    OSError,
    ValueError,
    TypeError,
    EOFError,
    SyntaxError,
    RuntimeError,
    OverflowError,
    MemoryError,
    zipfile.BadZipFile,
)
_LONGEST_HEADER = 2**16
"""Bytes of a header, which tells shape and type: numpy refuses one of more than 10,000 characters, once it has it."""

_PLAIN = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""What numpy writes. Others are unpacked by Python without a bound on what comes out at once."""


@dataclass(frozen=True)
class NpySource:
    """One array without a name; every name selects it."""

    path: Path

    def names(self) -> list[str]:
        """Return no names: any will do."""
        return []

    def pieces(self, name: str) -> Pieces:
        """Return the one array of the file as `Pieces`, which are read on demand; `name` is for messages alone.

        Raises DataError for a damaged file, Python objects, or an array that is too large for its stored bytes.
        """
        with _told(self.path), self.path.open("rb") as stream:
            shape, turned, dtype = described(stream)
        check_expansion(self.path, name, math.prod(shape) * dtype.itemsize, stored_bytes(self.path))
        return _array(self.path, name, (shape, turned, dtype), lambda: self.path.open("rb"))

    def unit(self, name: str) -> str | None:
        """Return None: numpy's files name no units."""
        return None


@dataclass(frozen=True)
class NpzSource:
    """Arrays by the names of their members, `.npy` taken off."""

    path: Path

    @cached_property
    def _members(self) -> dict[str, zipfile.ZipInfo]:
        try:
            with zipfile.ZipFile(self.path) as archive:
                found = archive.infolist()
        except _ERRORS as error:
            raise unreadable(self.path, error) from None
        members: dict[str, zipfile.ZipInfo] = {}
        for entry in found:
            name = entry.filename.removesuffix(".npy")
            if name in members:
                raise refuse(self.path, name, "stands for two members of the archive", "save it again with numpy")
            members[name] = entry
        # what a member tells of its size is checked when it is read
        check_expansion(self.path, "all members", sum(m.file_size for m in found), stored_bytes(self.path))
        return members

    def names(self) -> list[str]:
        """Return the names of the members."""
        return list(self._members)

    def pieces(self, name: str) -> Pieces | None:
        """Return the array of that name, None when there is none; raises DataError when it cannot be read."""
        entry = self._members.get(name)
        if entry is None:
            return None
        stored = min(entry.compress_size, stored_bytes(self.path))
        check_expansion(self.path, name, entry.file_size, stored)
        if entry.compress_type not in _PLAIN:
            raise refuse(self.path, name, f"is packed by method {entry.compress_type}", "save it again with numpy")
        with _told(self.path), zipfile.ZipFile(self.path) as archive, archive.open(entry) as stream:
            shape, turned, dtype = described(stream)
        found = _array(self.path, name, (shape, turned, dtype), lambda: self._open(entry))
        if found.nbytes > entry.file_size:
            what = f"claims shape {shape} in {entry.file_size} bytes"
            raise refuse(self.path, name, what, "restore the file from a copy")
        return found

    @contextmanager
    def _open(self, entry: zipfile.ZipInfo) -> Iterator[IO[bytes]]:
        with zipfile.ZipFile(self.path) as archive, archive.open(entry) as stream:
            yield stream

    def unit(self, name: str) -> str | None:
        """Return None: numpy's files name no units."""
        return None


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """Turn whatever a damaged file raises into a DataError that names it."""
    try:
        yield
    except _ERRORS as error:
        raise unreadable(path, error) from None


def _array(
    path: Path,
    name: str,
    what: tuple[tuple[int, ...], bool, np.dtype[Any]],
    opened: Callable[[], AbstractContextManager[IO[bytes]]],
) -> Pieces:
    """Return the array of this shape, order and type that the stream holds which `opened` gives anew each time."""
    shape, turned, dtype = what
    if dtype.hasobject:
        raise refuse(path, name, "holds Python objects", "save real numbers")

    def read() -> Iterator[NDArray[Any]]:
        with _told(path), opened() as stream:
            described(stream)
            left = math.prod(shape) * dtype.itemsize
            while left:
                # whole numbers only: a stream gives what it has, not what it is asked for
                data = _exactly(stream, min(left, max(PIECE_BYTES // dtype.itemsize, 1) * dtype.itemsize))
                left -= len(data)
                yield np.frombuffer(data, dtype)
            if stream.read(1):
                raise ValueError("there is more than its shape says")

    return Pieces(shape[::-1] if turned else shape, dtype, read, turned)


def described(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return shape, whether it is in Fortran's order, and type; raises ValueError for a header beyond all need.

    A header may claim 4 GiB, and numpy reads it before it looks at its length; it may claim less than nothing.
    """
    version = np.lib.format.read_magic(stream)
    count = _exactly(stream, 2 if version == (1, 0) else 4)
    length = int.from_bytes(count, "little")
    if length > _LONGEST_HEADER:
        raise ValueError(f"its header has {length} bytes, of at most {_LONGEST_HEADER}")
    read_header: Callable[..., tuple[tuple[int, ...], bool, np.dtype[Any]]] = (
        np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    )
    shape, turned, dtype = read_header(BytesIO(count + _exactly(stream, length)))
    if any(n < 0 for n in shape):
        raise ValueError(f"its header claims the shape {shape}")
    return shape, turned, dtype


def _exactly(stream: IO[bytes], count: int) -> bytes:
    data = bytearray()
    while len(data) < count:
        more = stream.read(count - len(data))
        if not more:
            raise EOFError(f"ends after {len(data)} of {count} bytes of a piece")
        data += more
    return bytes(data)
