"""Datasets of HDF5 files and of MATLAB's of version 7.3: for the child of `foreign`, as HDF5 may not survive them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from campaigns.importing.matlab_objects import class_of, refusal
from campaigns.importing.packing import PACKING, unpacked
from campaigns.importing.pieces import Pieces, boxes
from campaigns.importing.refusals import unreadable
from campaigns.log.guard import check_dataset, link_names, member, open_h5
from sim_backend.errors import DataError

AnyArray = NDArray[Any]

MOST_NAMES = 10_000
MOST_LEVELS = 32
"""Groups within groups that are looked into: they may hold each other."""


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

    def all_names(self) -> list[str]:
        """Return the paths of datasets and fields in all groups, at most MOST_NAMES; a link stands for itself."""
        with open_h5(self.path) as file:
            return list(islice(self._below(file, "", frozenset()), MOST_NAMES))

    def _below(self, group: h5py.Group, before: str, above: frozenset[int]) -> Iterator[str]:
        """Yield what is in a group and below it; `above` are the groups that it is in, which it may hold again."""
        for name in link_names(group, self.path):
            if name.startswith("#"):
                continue
            try:
                found = member(group, name, self.path)
            except DataError:
                yield before + name  # why it is refused is told to who asks for it
                continue
            if self.matlab and class_of(found) is not None:
                continue
            if isinstance(found, h5py.Dataset):
                yield from _fields(before + name, found.dtype, "." if self.matlab else "/")
                continue
            address = h5py.h5o.get_info(found.id).addr
            if address not in above and len(above) < MOST_LEVELS:
                yield from self._below(found, f"{before}{name}{'.' if self.matlab else '/'}", above | {address})

    def pieces(self, name: str) -> Pieces | None:
        """Return the dataset at that path, None when there is none; raises DataError when it is refused."""
        with open_h5(self.path) as file:
            found, fields = self._find(file, name)
            if found is None:
                return None
            if self.matlab and (kind := class_of(found)) is not None:
                raise refusal(self.path, name, kind)
            check_dataset(found, self.path, name)
            attributes = {key: _plain(found, key, self.path) for key in PACKING} if not fields else {}
            dtype = found.dtype
            for step in fields:
                if step not in (dtype.names or ()):
                    return None
                dtype = dtype[step]
            # a field may hold several numbers of a row
            shape, dtype = found.shape + dtype.shape, dtype.base
        return as_meant(Pieces(shape, dtype, lambda: self._read(name, fields), self.matlab), attributes)

    def _read(self, name: str, fields: list[str]) -> Iterator[AnyArray]:
        with open_h5(self.path) as file:
            found, _ = self._find(file, name)
            assert found is not None
            try:
                for box in boxes(found.shape, found.dtype.itemsize, found.chunks):
                    values = np.asarray(found[box])
                    for step in fields:
                        values = values[step]
                    yield values
            except (OSError, RuntimeError, ValueError, TypeError) as error:
                raise unreadable(self.path, error) from None

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


def _fields(name: str, dtype: np.dtype[Any], sign: str) -> Iterator[str]:
    """Yield the names of a dataset's fields, its own where it has none."""
    if not dtype.names:
        yield name
    for field in dtype.names or ():
        yield from _fields(f"{name}{sign}{field}", dtype[field], sign)


def as_meant(packed: Pieces, attributes: Mapping[str, Any]) -> Pieces:
    """Return numbers as the attributes mean them; of which type they are shows when all of them were seen."""
    if not any(value is not None for value in attributes.values()):
        return packed
    kinds = {unpacked(piece, attributes).dtype for piece in packed.read()} or {packed.dtype}
    dtype = np.result_type(*kinds)

    def read() -> Iterator[AnyArray]:
        for piece in packed.read():
            yield unpacked(piece, attributes).astype(dtype, copy=False)

    return Pieces(packed.shape, dtype, read, packed.turned, packed.dtype)


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
