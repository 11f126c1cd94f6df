"""HDF5 and MATLAB files, whose parsers may not survive hostile bytes: used in a child process alone (`isolated`)."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io
from numpy.typing import NDArray

from campaigns.importing.refusals import check_expansion, unreadable
from campaigns.log.child import bound_memory
from campaigns.log.guard import MAX_EXPANSION, check_dataset, link_names, member, open_h5
from sim_backend.errors import DataError

AnyArray = NDArray[Any]


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
                raise unreadable(self.path, error) from None
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
        check_expansion(self.path, variable, size, self.path.stat().st_size)
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
            raise unreadable(self.path, error) from None


def child() -> None:
    """Answer questions about the file named on the command line until standard input ends.

    A question is one line of JSON, null for the names or the name of an array. So is an answer; that of an array is
    followed by its bytes, in C order of the shape that is told.
    """
    path = Path(sys.argv[1])
    bound_memory(MAX_EXPANSION * path.stat().st_size)
    for line in sys.stdin.buffer:
        try:
            answer, values = _answer(path, json.loads(line))
        except DataError as error:
            answer, values = {"refused": str(error)}, None
        except MemoryError as error:
            answer, values = {"refused": str(unreadable(path, error))}, None
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
    if found.dtype.kind not in "fiub":
        return {"type": str(found.dtype)}, None
    turned = not found.flags.c_contiguous and found.T.flags.c_contiguous  # spares a copy of MATLAB's order
    values = np.ascontiguousarray(found.T if turned else found)
    return {"dtype": values.dtype.str, "shape": values.shape, "turned": turned}, values


def _source(path: Path) -> Hdf5Source | MatSource:
    matlab = path.suffix.lower() == ".mat"
    return Hdf5Source(path, matlab) if h5py.is_hdf5(path) or not matlab else MatSource(path)
