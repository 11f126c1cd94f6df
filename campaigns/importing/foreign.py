"""Files whose parsers hostile bytes may crash, block or fill the memory with, in a child process alone.

`isolated` starts that process and talks with it.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import struct
import sys
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

import h5py
import numpy as np
import scipy
from numpy.typing import NDArray

from campaigns.importing.hdf5 import Hdf5Source, as_meant
from campaigns.importing.kinds import is_packaged
from campaigns.importing.matlab_objects import Variable, refusal, unpacked_bytes, variables_in
from campaigns.importing.npz import NpySource, NpzSource
from campaigns.importing.packaged import PackagedSource, importer_of
from campaigns.importing.packing import PACKING
from campaigns.importing.pieces import Pieces, boxes, of_array
from campaigns.importing.refusals import check_expansion, unreadable
from campaigns.log.child import bound_memory, tell_ready
from campaigns.log.guard import most_bytes, stored_bytes
from sim_backend.errors import DataError

AnyArray = NDArray[Any]

HDF5_MARK = b"\x89HDF\r\n\x1a\n"
HEAD_BYTES = 512 + len(HDF5_MARK)
"""So much of a file shows the mark of HDF5: at its beginning, or behind the 512 bytes that MATLAB puts before it."""


@dataclass(frozen=True)
class Netcdf3Source:
    """Variables of a classic NetCDF file, unpacked as its attributes say (see `packing`)."""

    path: Path

    def names(self) -> list[str]:
        """Return the names of the variables."""
        return list(self._file.variables)

    def pieces(self, name: str) -> Pieces | None:
        """Return the variable of that name, None when there is none; raises DataError when damaged."""
        found = self._file.variables.get(name)
        if found is None:
            return None
        # of what is packed there is as much as is stored
        check_expansion(self.path, name, found.data.nbytes, stored_bytes(self.path))
        shape, dtype = found.data.shape, found.data.dtype

        def read() -> Iterator[AnyArray]:
            for box in boxes(shape, dtype.itemsize):
                yield np.array(found.data[box])

        return as_meant(Pieces(shape, dtype, read), {key: getattr(found, key, None) for key in PACKING})

    def unit(self, name: str) -> str | None:
        """Return the unit that the file names for a variable."""
        told = getattr(self._file.variables.get(name), "units", None)
        return told.decode("utf-8", "replace") if isinstance(told, bytes) else None

    @cached_property
    def _file(self) -> Any:
        check_expansion(self.path, self.path.name, self.path.stat().st_size, stored_bytes(self.path))
        try:
            return scipy.io.netcdf_file(self.path, "r", mmap=True)
        except Exception as error:  # a parser of foreign bytes fails in any way; there is no narrower class
            raise unreadable(self.path, error) from None


@dataclass(frozen=True)
class TdmsSource:
    """Channels of a TDMS file (LabVIEW) as `group/channel`, in the unit that the file scales them to."""

    path: Path

    def names(self) -> list[str]:
        """Return all channels."""
        return list(self._channels)

    def pieces(self, name: str) -> Pieces | None:
        """Return a channel's numbers, None when there is none; raises DataError when damaged."""
        channel = self._channels.get(name)
        if channel is None:
            return None
        # what is no number has a type of its own for each row
        dtype = np.dtype(channel.dtype if channel.dtype is not None else object)
        check_expansion(self.path, name, len(channel) * dtype.itemsize, stored_bytes(self.path))

        def read() -> Iterator[AnyArray]:
            try:
                for chunk in channel.data_chunks():  # as they lie in the file: a part of one is not read alone
                    yield np.asarray(chunk[:])
            except Exception as error:  # as above
                raise unreadable(self.path, error) from None

        return Pieces((len(channel),), dtype, read)

    def unit(self, name: str) -> str | None:
        """Return the unit that the file names for a channel."""
        channel = self._channels.get(name)
        told = channel.properties.get("unit_string") if channel is not None else None
        return told if isinstance(told, str) and told else None

    @cached_property
    def _channels(self) -> dict[str, Any]:
        nptdms = optional("nptdms", self.path)
        try:
            file = nptdms.TdmsFile.open(self.path)
            return {f"{group.name}/{channel.name}": channel for group in file.groups() for channel in group.channels()}
        except Exception as error:  # as above
            raise unreadable(self.path, error) from None


@dataclass(frozen=True)
class ParquetSource:
    """Columns of a Parquet file."""

    path: Path

    def names(self) -> list[str]:
        """Return the names of the columns."""
        return list(self._file().schema_arrow.names)

    def pieces(self, name: str) -> Pieces | None:
        """Return a column, missing numbers as not-a-number, None when there is none; raises DataError when damaged."""
        file = self._file()
        if name not in file.schema_arrow.names:
            return None
        rows = file.metadata.num_rows
        check_expansion(self.path, name, 8 * rows, stored_bytes(self.path))
        # a column of whole numbers has another type where some are missing
        kinds = {piece.dtype for piece in self._read(name)}
        dtype = np.result_type(*kinds) if kinds and not any(kind.hasobject for kind in kinds) else np.dtype(object)

        def read() -> Iterator[AnyArray]:
            for piece in self._read(name):
                yield piece.astype(dtype, copy=False)

        return Pieces((rows,), dtype, read)

    def _read(self, name: str) -> Iterator[AnyArray]:
        try:
            for batch in self._file().iter_batches(BATCH_ROWS, columns=[name], use_threads=False):
                yield batch.column(0).to_numpy(zero_copy_only=False)
        except Exception as error:  # as above
            raise unreadable(self.path, error) from None

    def unit(self, name: str) -> str | None:
        """Return the unit in the column's metadata."""
        file = self._file()
        own = file.schema_arrow.field(name).metadata if name in file.schema_arrow.names else None
        return own[b"unit"].decode("utf-8", "replace") if own and b"unit" in own else None

    def _file(self) -> Any:
        parquet = optional("pyarrow.parquet", self.path)
        try:
            return parquet.ParquetFile(self.path)
        except Exception as error:  # as above
            raise unreadable(self.path, error) from None


BATCH_ROWS = 2**18


def optional(library: str, path: Path) -> Any:
    """Return a library that is there only with the extra `formats`; raises DataError that says how to install it."""
    try:
        return import_module(library)
    except ImportError:
        name = library.partition(".")[0]
        raise DataError(f"{path} needs the library {name}: install it with `pip install 'mccd[formats]'`") from None


@dataclass(frozen=True)
class MatSource:
    """Variables of a MATLAB file up to version 7; a field of a structure is selected as `structure.field`."""

    path: Path
    bounded: bool = False
    """Whether the memory of this process is bounded, and may be raised for a variable."""
    _shapes: dict[str, tuple[int, ...]] = field(default_factory=dict, repr=False)

    def names(self) -> list[str]:
        """Return the names of the variables but objects; raises DataError when the file is damaged."""
        if not self._shapes and self._objects:  # scipy's list fails on an object
            self._shapes.update({one.name: one.shape for one in self._walked if not one.object_of and one.name})
        elif not self._shapes:
            found = self._parse(lambda: scipy.io.whosmat(self.path))
            self._shapes.update({name: tuple(shape) for name, shape, _ in found})
        return list(self._shapes)

    def all_names(self) -> list[str]:
        """Return the names of variables but objects, of structures those of their fields; raises DataError as `names`.

        A structure that is refused stands for itself.
        """
        structures = {one.name for one in self._walked if one.is_structure}
        found: list[str] = []
        for name in self.names():
            try:
                found += _fields(name, self._variable(name)) if name in structures else [name]
            except DataError:
                found.append(name)
        return found

    @cached_property
    def _objects(self) -> dict[str, str]:
        """Classes of objects by name."""
        return {one.name: one.object_of for one in self._walked if one.object_of}

    @cached_property
    def _walked(self) -> list[Variable]:
        """All variables; none of a file of another format, whose error scipy's parser reports."""
        try:
            return variables_in(self.path)
        except (ValueError, OSError, zlib.error, struct.error):
            return []

    def pieces(self, name: str) -> Pieces | None:
        """Return the variable or field of that name, None when there is none; raises DataError when damaged."""
        variable, *fields = name.split(".")
        if variable in self._objects:
            raise refusal(self.path, variable, self._objects[variable])
        if variable not in self.names():
            return None
        found = self._variable(variable)
        for step in fields:
            if not isinstance(found, np.ndarray) or found.size != 1 or step not in (found.dtype.names or ()):
                return None
            found = found[step].flat[0]
        return of_array(found) if isinstance(found, np.ndarray) else None

    def _variable(self, name: str) -> Any:
        self._bound(name)
        return self._parse(lambda: scipy.io.loadmat(self.path, variable_names=[name])[name])

    def _bound(self, variable: str) -> None:
        """Let this process take what the variable needs, once that is known to be no bomb: scipy reads it whole."""
        stored = stored_bytes(self.path)
        check_expansion(self.path, variable, 8 * math.prod(int(n) for n in self._shapes[variable]), stored)
        size = self._parse(lambda: unpacked_bytes(self.path, variable, most_bytes(stored)))
        if size > most_bytes(stored):
            raise unreadable(self.path, MemoryError())
        if self.bounded:  # whole numbers of one byte stand for those of eight
            bound_memory(size + min(8 * size, most_bytes(stored)))

    def unit(self, name: str) -> str | None:
        """Return None: these files name no units."""
        return None

    def _parse(self, read: Callable[[], Any]) -> Any:
        try:
            return read()
        except Exception as error:  # a parser of foreign bytes fails in any way; there is no narrower class
            raise unreadable(self.path, error) from None


def _fields(name: str, found: AnyArray) -> list[str]:
    """Return the names of the fields of a structure, and of those in it; its own where it is an array of several."""
    if not found.dtype.names or found.size != 1:
        return [name]
    return [one for field in found.dtype.names for one in _fields(f"{name}.{field}", found[field].flat[0])]


Foreign = NpySource | NpzSource | Hdf5Source | MatSource | Netcdf3Source | TdmsSource | ParquetSource | PackagedSource


def child() -> None:
    """Answer questions about the file named on the command line until standard input ends.

    A question is one line of JSON: null for the names at the top, true for all names, or the name of an array. So is an
    answer; that of an array is followed by its bytes, in C order of the stated shape. Dates come as nanoseconds since
    1970.
    """
    path = Path(sys.argv[1])
    _load_parsers(path)
    bound_memory(_held_at_once(path))
    tell_ready()
    source = _source(path, bounded=True)
    for line in sys.stdin.buffer:
        try:
            answer, found = _answer(source, json.loads(line))
            for _ in found.read() if found is not None else ():
                pass  # what is refused in the middle has cost nobody memory
        except DataError as error:
            answer, found = {"refused": str(error)}, None
        except (MemoryError, RecursionError) as error:
            answer, found = {"refused": str(unreadable(path, error))}, None
        _say(answer, found)


PACKAGED_SHARE = 8
"""How many times the size of its file the importer of another package may hold, which reads it all at once."""


def _held_at_once(path: Path) -> int:
    """Return how much of a file its parser may hold, or map, beside what it hands on."""
    size = path.stat().st_size
    shares = {".nc": 1, ".tdms": 2, ".parquet": 1}  # what is read, and the numbers that are made of it
    share = PACKAGED_SHARE if is_packaged(path) else shares.get(path.suffix.lower(), 0)
    return share * size if size <= most_bytes(stored_bytes(path)) else 0


def _load_parsers(path: Path) -> None:
    """Import what only some files need and takes as long as all else here, before this process's memory is bounded."""
    if is_packaged(path):
        with contextlib.suppress(DataError):  # told when the file is asked for
            importer_of(path)
    if path.suffix.lower() == ".parquet":
        os.environ["ARROW_DEFAULT_MEMORY_POOL"] = "system"  # others reserve more than a process may have here
        with contextlib.suppress(ImportError):
            import_module("pyarrow.parquet")
    if path.suffix.lower() in (".mat", ".nc"):
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
        if HDF5_MARK not in head:
            import_module("scipy.io")


def _say(answer: dict[str, Any], found: Pieces | None = None) -> None:
    """Write an answer and its numbers; what fails in the middle of them ends this process, and so the answer."""
    sys.stdout.buffer.write(json.dumps(answer).encode() + b"\n")
    if found is not None:
        dated, left = answer["dated"], math.prod(found.shape)
        for piece in found.read():
            plain = np.ascontiguousarray(_nanoseconds(piece) if dated else piece).reshape(-1)
            left -= plain.size
            if left < 0:
                raise ValueError("more numbers than the shape has")
            sys.stdout.buffer.write(plain.view(np.uint8).data)
        if left:
            raise EOFError
    sys.stdout.buffer.flush()


def _answer(source: Foreign, name: str | Literal[True] | None) -> tuple[dict[str, Any], Pieces | None]:
    if name is None:
        return {"names": source.names()}, None
    if name is True:
        return {"names": source.all_names() if isinstance(source, Hdf5Source | MatSource) else source.names()}, None
    found = source.pieces(name)
    if found is None:
        return {"absent": True}, None
    if found.dtype.kind not in "fiubM":
        return {"type": str(found.dtype)}, None
    dated = found.dtype.kind == "M"
    kind = "<i8" if dated else found.dtype.str
    told = {"dtype": kind, "shape": found.shape, "turned": found.turned, "dated": dated}
    return told | {"unit": source.unit(name), "stored": (found.packed or found.dtype).str}, found


def _nanoseconds(dates: AnyArray) -> AnyArray:
    return dates.astype("datetime64[ns]").view(np.int64)


def _source(path: Path, *, bounded: bool = False) -> Foreign:
    """Return the source for a file by its suffix; `bounded` says that the memory of this process is."""
    kind = path.suffix.lower()
    if is_packaged(path):
        return PackagedSource(path)
    if kind in (".npy", ".npz"):
        return NpySource(path) if kind == ".npy" else NpzSource(path)
    if kind == ".tdms":
        return TdmsSource(path)
    if kind == ".parquet":
        return ParquetSource(path)
    if kind == ".nc" and not h5py.is_hdf5(path):
        return Netcdf3Source(path)
    matlab = kind == ".mat"
    return Hdf5Source(path, matlab) if h5py.is_hdf5(path) or not matlab else MatSource(path, bounded)
