"""Files that data can be imported from: one class per kind, all asked for arrays by name."""

from __future__ import annotations

import difflib
import math
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import h5py
import numpy as np
import scipy.io
from numpy.typing import NDArray

from campaigns.importing.selecting import parse_selection
from campaigns.importing.text import TextSource
from campaigns.log.guard import (
    FREE_BYTES,
    MAX_EXPANSION,
    check_dataset,
    first_line,
    link_names,
    member,
    open_h5,
    refuse,
)
from sim_backend.errors import ConfigError, DataError

AnyArray = NDArray[Any]


class Source(Protocol):
    """A file of named arrays."""

    @property
    def path(self) -> Path:
        """Where the file is."""

    def names(self) -> list[str]:
        """Return the names that can be selected."""

    def array(self, name: str) -> AnyArray | None:
        """Return the array of that name, None when there is none; raises DataError when it cannot be read."""


@dataclass(frozen=True)
class NpySource:
    """One array without a name, mapped from disk; every name selects it."""

    path: Path

    def names(self) -> list[str]:
        """Return no names: any will do."""
        return []

    def array(self, name: str) -> AnyArray | None:
        """Return the array; raises DataError when the file is damaged or holds Python objects."""
        try:
            return np.load(self.path, mmap_mode="r", allow_pickle=False)
        except (OSError, ValueError, TypeError, EOFError, SyntaxError, OverflowError, MemoryError) as error:
            raise _unreadable(self.path, error) from None


@dataclass(frozen=True)
class NpzSource:
    """Arrays in a zip archive; the size that each member claims is checked before it is unpacked."""

    path: Path

    @cached_property
    def _members(self) -> dict[str, zipfile.ZipInfo]:
        try:
            with zipfile.ZipFile(self.path) as archive:
                found = archive.infolist()
        except (OSError, ValueError, zipfile.BadZipFile, NotImplementedError) as error:
            raise _unreadable(self.path, error) from None
        return {entry.filename.removesuffix(".npy"): entry for entry in found}

    def names(self) -> list[str]:
        """Return the names of the members."""
        return list(self._members)

    def array(self, name: str) -> AnyArray | None:
        """Return the array of that name, None when there is none; raises DataError when it cannot be read."""
        entry = self._members.get(name)
        if entry is None:
            return None
        _check_expansion(self.path, name, entry.file_size, entry.compress_size)
        try:
            with zipfile.ZipFile(self.path) as archive, archive.open(entry) as stream:
                version = np.lib.format.read_magic(stream)
                read_header: Callable[..., Any] = (
                    np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
                )
                shape, _, dtype = read_header(stream)
                if math.prod(shape) * dtype.itemsize > entry.file_size:
                    what = f"claims shape {shape} in {entry.file_size} bytes"
                    raise refuse(self.path, name, what, "restore the file from a copy")
            with np.load(self.path, allow_pickle=False) as archive:
                return np.asarray(archive[name])
        except (
            OSError,
            ValueError,
            TypeError,
            EOFError,
            SyntaxError,
            RuntimeError,
            MemoryError,
            zipfile.BadZipFile,
        ) as error:
            raise _unreadable(self.path, error) from None


@dataclass(frozen=True)
class Hdf5Source:
    """Datasets of an HDF5 file by their path; those of a MATLAB 7.3 file with the axes in MATLAB's order."""

    path: Path
    matlab: bool = False

    def names(self) -> list[str]:
        """Return the names at the top of the file."""
        with open_h5(self.path) as file:
            return [name for name in link_names(file, self.path) if not name.startswith("#")]

    def array(self, name: str) -> AnyArray | None:
        """Return the dataset at that path, None when there is none; raises DataError when it is refused."""
        with open_h5(self.path) as file:
            found: h5py.Group | h5py.Dataset = file
            for step in name.replace(".", "/").split("/") if self.matlab else name.strip("/").split("/"):
                if not isinstance(found, h5py.Group) or step not in link_names(found, self.path):
                    return None
                found = member(found, step, self.path)
            if not isinstance(found, h5py.Dataset):
                return None
            check_dataset(found, self.path, name)
            try:
                values = np.asarray(found[()])
            except (OSError, RuntimeError, ValueError, TypeError, MemoryError) as error:
                raise _unreadable(self.path, error) from None
        return values.T if self.matlab else values


@dataclass(frozen=True)
class MatSource:
    """Variables of a MATLAB file up to version 7; a field of a structure is selected as `structure.field`."""

    path: Path
    _shapes: dict[str, tuple[int, ...]] = field(default_factory=dict, repr=False)

    def names(self) -> list[str]:
        """Return the names of the variables; raises DataError when the file is damaged."""
        if not self._shapes:
            found = self._parse(lambda: scipy.io.whosmat(self.path))
            self._shapes.update({name: tuple(shape) for name, shape, _ in found})
        return list(self._shapes)

    def array(self, name: str) -> AnyArray | None:
        """Return the variable or field of that name, None when there is none; raises DataError when damaged."""
        variable, *fields = name.split(".")
        if variable not in self.names():
            return None
        size = 8 * math.prod(int(length) for length in self._shapes[variable])
        _check_expansion(self.path, variable, size, self.path.stat().st_size)
        found = self._parse(lambda: scipy.io.loadmat(self.path, variable_names=[variable])[variable])
        for step in fields:
            if not isinstance(found, np.ndarray) or found.size != 1 or step not in (found.dtype.names or ()):
                return None
            found = found[step].flat[0]
        return found if isinstance(found, np.ndarray) else None

    def _parse(self, read: Callable[[], Any]) -> Any:
        try:
            return read()
        except Exception as error:  # a parser of foreign bytes fails in any way; there is no narrower class
            raise _unreadable(self.path, error) from None


SUFFIXES = (".csv", ".tsv", ".npy", ".npz", ".mat", ".h5", ".hdf5")


def open_source(path: Path, delimiter: str | None = None, decimal: str = ".") -> Source:
    """Return the source for the file at `path` by its suffix; raises DataError when it is none of `SUFFIXES`."""
    if not path.is_file():
        raise DataError(f"source {path} is no file: check the path, which counts from the map's folder")
    kind = path.suffix.lower()
    if kind in (".csv", ".tsv"):
        return TextSource(path, delimiter or ("," if kind == ".csv" else "\t"), decimal)
    if kind == ".npy":
        return NpySource(path)
    if kind == ".npz":
        return NpzSource(path)
    if kind == ".mat":
        return Hdf5Source(path, matlab=True) if h5py.is_hdf5(path) else MatSource(path)
    if kind in (".h5", ".hdf5"):
        return Hdf5Source(path)
    raise DataError(f"source {path} has the suffix '{kind}': readable are {', '.join(SUFFIXES)}")


def select(source: Source, text: str) -> AnyArray:
    """Return what `select = text` means in `source`; a name that is there as it stands wins over indices.

    Raises DataError naming what there is instead, ConfigError for indices that do not fit.
    """
    whole = source.array(text) if text in source.names() else None
    if whole is not None:
        return whole
    selection = parse_selection(text)
    found = source.array(selection.name)
    if found is None:
        names = source.names()
        near = difflib.get_close_matches(selection.name, names, n=1)
        hint = f"did you mean '{near[0]}'? " if near else ""
        shown = ", ".join(names[:20]) + (f" and {len(names) - 20} more" if len(names) > 20 else "")
        raise DataError(f"{source.path} has no variable '{selection.name}': {hint}it has {shown or 'none'}")
    try:
        return found[selection.indices] if selection.indices else found
    except IndexError:
        raise ConfigError(
            f"select '{text}' does not fit {source.path}, which holds shape {found.shape}: correct the indices"
        ) from None


def _check_expansion(path: Path, item: str, size: int, stored: int) -> None:
    limit = max(MAX_EXPANSION * stored, FREE_BYTES)
    if size > limit:
        what = f"unpacks to {size} bytes of at most {limit} for {stored} stored bytes"
        raise refuse(path, item, what, "store it with less compression")


def _unreadable(path: Path, error: Exception) -> DataError:
    return DataError(f"cannot read {path}: {first_line(error)}; check that it is what its suffix says")
