"""Files whose parsers may not survive hostile bytes (HDF5, NetCDF, MATLAB, TDMS, Parquet), in a child process alone.

`isolated` starts that process and talks with it.
"""

from __future__ import annotations

import json
import math
import struct
import sys
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy
from numpy.typing import NDArray

from campaigns.importing.matlab_objects import Variable, class_of, refusal, variables_in
from campaigns.importing.packing import PACKING, unpacked
from campaigns.importing.refusals import check_expansion, unreadable
from campaigns.log.child import bound_memory, tell_ready
from campaigns.log.guard import MAX_EXPANSION, check_dataset, link_names, member, open_h5
from sim_backend.errors import DataError

AnyArray = NDArray[Any]

HDF5_MARK = b"\x89HDF\r\n\x1a\n"
HEAD_BYTES = 512 + len(HDF5_MARK)
"""So much of a file shows the mark of HDF5: at its beginning, or behind the 512 bytes that MATLAB puts before it."""


@dataclass(frozen=True)
class Hdf5Source:
    """Datasets of an HDF5 file by their path; those of a MATLAB 7.3 file with the axes in MATLAB's order.

    A field of a compound dataset is selected as one more step of the path. Packed numbers are unpacked as the file's
    attributes say (see `packing`).
    """

    path: Path
    matlab: bool = False

    def names(self) -> list[str]:
        """Return the names at the top of the file."""
        with open_h5(self.path) as file:
            names = [name for name in link_names(file, self.path) if not name.startswith("#")]
            return [n for n in names if not self.matlab or class_of(member(file, n, self.path)) is None]

    def array(self, name: str) -> AnyArray | None:
        """Return the dataset at that path, None when there is none; raises DataError when it is refused."""
        with open_h5(self.path) as file:
            found, fields = self._find(file, name)
            if found is None:
                return None
            if self.matlab and (kind := class_of(found)) is not None:
                raise refusal(self.path, name, kind)
            check_dataset(found, self.path, name)
            try:
                values = np.asarray(found[()])
            except (OSError, RuntimeError, ValueError, TypeError, MemoryError) as error:
                raise unreadable(self.path, error) from None
            for step in fields:
                if step not in (values.dtype.names or ()):
                    return None
                values = values[step]
            attributes = {key: _plain(found, key, self.path) for key in PACKING} if not fields else {}
        return unpacked(values.T if self.matlab else values, attributes)

    def unit(self, name: str) -> str | None:
        """Return the unit that the file names for the dataset at that path."""
        with open_h5(self.path) as file:
            found, fields = self._find(file, name)
            told = None if found is None or fields else _plain(found, "units", self.path)
        return told if isinstance(told, str) else None

    def _find(self, file: h5py.File, name: str) -> tuple[h5py.Dataset | None, list[str]]:
        """Return the dataset on a path, and the steps that go on in it."""
        found: h5py.Group | h5py.Dataset = file
        steps = name.replace(".", "/").split("/") if self.matlab else name.strip("/").split("/")
        for k, step in enumerate(steps):
            if isinstance(found, h5py.Dataset):
                return found, steps[k:]
            if step not in link_names(found, self.path):
                return None, []
            found = member(found, step, self.path)
        return (found, []) if isinstance(found, h5py.Dataset) else (None, [])


def _plain(dataset: h5py.Dataset, name: str, path: Path) -> str | float | AnyArray | None:
    """Return an attribute that is a text, a number or some numbers; None for any other."""
    if not h5py.h5a.exists(dataset.id, name.encode()):
        return None
    kind = h5py.h5a.open(dataset.id, name.encode()).get_type()
    if not isinstance(kind, h5py.h5t.TypeStringID | h5py.h5t.TypeIntegerID | h5py.h5t.TypeFloatID):
        return None
    try:
        value = dataset.attrs[name]
    except (OSError, RuntimeError, ValueError, TypeError, UnicodeError) as error:
        raise unreadable(path, error) from None
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.flat[0]
        return value.decode("utf-8", "replace") if isinstance(value, bytes) else value
    return value


@dataclass(frozen=True)
class Netcdf3Source:
    """Variables of a classic NetCDF file, unpacked as its attributes say (see `packing`)."""

    path: Path

    def names(self) -> list[str]:
        """Return the names of the variables."""
        with self._opened() as file:
            return list(file.variables)

    def array(self, name: str) -> AnyArray | None:
        """Return the variable of that name, None when there is none; raises DataError when damaged."""
        with self._opened() as file:
            found = file.variables.get(name)
            if found is None:
                return None
            attributes = {key: getattr(found, key, None) for key in PACKING}
            return unpacked(np.array(found[...]), attributes)

    def unit(self, name: str) -> str | None:
        """Return the unit that the file names for a variable."""
        with self._opened() as file:
            told = getattr(file.variables.get(name), "units", None)
        return told.decode("utf-8", "replace") if isinstance(told, bytes) else None

    def _opened(self) -> Any:
        try:
            return scipy.io.netcdf_file(self.path, "r", mmap=False)
        except Exception as error:  # a parser of foreign bytes fails in any way; there is no narrower class
            raise unreadable(self.path, error) from None


@dataclass(frozen=True)
class TdmsSource:
    """Channels of a TDMS file (LabVIEW) as `group/channel`, in the unit that the file scales them to."""

    path: Path

    def names(self) -> list[str]:
        """Return all channels."""
        return list(self._channels)

    def array(self, name: str) -> AnyArray | None:
        """Return a channel's numbers, None when there is none; raises DataError when damaged."""
        channel = self._channels.get(name)
        if channel is None:
            return None
        try:
            return np.asarray(channel[:])
        except Exception as error:  # as above
            raise unreadable(self.path, error) from None

    def unit(self, name: str) -> str | None:
        """Return the unit that the file names for a channel."""
        channel = self._channels.get(name)
        told = channel.properties.get("unit_string") if channel is not None else None
        return told if isinstance(told, str) and told else None

    @cached_property
    def _channels(self) -> dict[str, Any]:
        nptdms = optional("nptdms", self.path)
        try:
            file = nptdms.TdmsFile.read(self.path)
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

    def array(self, name: str) -> AnyArray | None:
        """Return a column, missing numbers as not-a-number, None when there is none; raises DataError when damaged."""
        file = self._file()
        if name not in file.schema_arrow.names:
            return None
        try:
            return np.asarray(file.read(columns=[name]).column(0).to_pandas().to_numpy())
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


def optional(library: str, path: Path) -> Any:
    """Return a library that is there only with the extra `formats`; raises DataError with the way to install it."""
    try:
        return import_module(library)
    except ImportError:
        name = library.partition(".")[0]
        raise DataError(f"{path} needs the library {name}: install it with `pip install 'mccd[formats]'`") from None


@dataclass(frozen=True)
class MatSource:
    """Variables of a MATLAB file up to version 7; a field of a structure is selected as `structure.field`."""

    path: Path
    _shapes: dict[str, tuple[int, ...]] = field(default_factory=dict, repr=False)

    def names(self) -> list[str]:
        """Return the names of the variables but objects; raises DataError when the file is damaged."""
        if not self._shapes and self._objects:  # scipy's list fails on an object
            self._shapes.update({one.name: one.shape for one in self._walked if not one.object_of and one.name})
        elif not self._shapes:
            found = self._parse(lambda: scipy.io.whosmat(self.path))
            self._shapes.update({name: tuple(shape) for name, shape, _ in found})
        return list(self._shapes)

    @cached_property
    def _objects(self) -> dict[str, str]:
        """Classes of objects by name."""
        return {one.name: one.object_of for one in self._walked if one.object_of}

    @cached_property
    def _walked(self) -> list[Variable]:
        """All variables; none of a file that has another form, of which scipy's parser tells what is wrong."""
        try:
            return variables_in(self.path)
        except (ValueError, OSError, zlib.error, struct.error):
            return []

    def array(self, name: str) -> AnyArray | None:
        """Return the variable or field of that name, None when there is none; raises DataError when damaged."""
        variable, *fields = name.split(".")
        if variable in self._objects:
            raise refusal(self.path, variable, self._objects[variable])
        if variable not in self.names():
            return None
        size = 8 * math.prod(int(length) for length in self._shapes[variable])
        check_expansion(self.path, variable, size, self.path.stat().st_size)
        found = self._parse(lambda: scipy.io.loadmat(self.path, variable_names=[variable])[variable])
        for step in fields:
            if not isinstance(found, np.ndarray) or found.size != 1 or step not in (found.dtype.names or ()):
                return None
            found = found[step].flat[0]
        return found if isinstance(found, np.ndarray) else None

    def unit(self, name: str) -> str | None:
        """Return None: these files name no units."""
        return None

    def _parse(self, read: Callable[[], Any]) -> Any:
        try:
            return read()
        except Exception as error:  # a parser of foreign bytes fails in any way; there is no narrower class
            raise unreadable(self.path, error) from None


def child() -> None:
    """Answer questions about the file named on the command line until standard input ends.

    A question is one line of JSON, null for the names or the name of an array. So is an answer; that of an array is
    followed by its bytes, in C order of the shape that is told. Dates come as nanoseconds since 1970.
    """
    path = Path(sys.argv[1])
    _load_parsers(path)
    bound_memory(MAX_EXPANSION * path.stat().st_size)
    tell_ready()
    for line in sys.stdin.buffer:
        try:
            answer, values = _answer(path, json.loads(line))
        except DataError as error:
            answer, values = {"refused": str(error)}, None
        except MemoryError as error:
            answer, values = {"refused": str(unreadable(path, error))}, None
        _say(answer, values)


def _load_parsers(path: Path) -> None:
    """Import what only some files need and takes as long as all else here, before this process's memory is bounded."""
    if path.suffix.lower() in (".mat", ".nc"):
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
        if HDF5_MARK not in head:
            import_module("scipy.io")


def _say(answer: dict[str, Any], values: AnyArray | None = None) -> None:
    sys.stdout.buffer.write(json.dumps(answer).encode() + b"\n")
    if values is not None:
        sys.stdout.buffer.write(values.reshape(-1).view(np.uint8).data)
    sys.stdout.buffer.flush()


def _answer(path: Path, name: str | None) -> tuple[dict[str, Any], AnyArray | None]:
    source = _source(path)
    if name is None:
        return {"names": source.names()}, None
    found = source.array(name)
    if found is None:
        return {"absent": True}, None
    if found.dtype.kind not in "fiubM":
        return {"type": str(found.dtype)}, None
    if found.dtype.kind == "M":
        found = found.astype("datetime64[ns]").view(np.int64)
        dated = True
    else:
        dated = False
    turned = not found.flags.c_contiguous and found.T.flags.c_contiguous  # spares a copy of MATLAB's order
    values = np.ascontiguousarray(found.T if turned else found)
    told = {"dtype": values.dtype.str, "shape": values.shape, "turned": turned, "dated": dated}
    return told | {"unit": source.unit(name)}, values


def _source(path: Path) -> Hdf5Source | MatSource | Netcdf3Source | TdmsSource | ParquetSource:
    kind = path.suffix.lower()
    if kind == ".tdms":
        return TdmsSource(path)
    if kind == ".parquet":
        return ParquetSource(path)
    if kind == ".nc" and not h5py.is_hdf5(path):
        return Netcdf3Source(path)
    matlab = kind == ".mat"
    return Hdf5Source(path, matlab) if h5py.is_hdf5(path) or not matlab else MatSource(path)
