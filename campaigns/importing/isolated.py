"""A source read by a process of its own, with bounded memory and time: this one never parses a byte of the file.

A flipped byte in an index is enough to crash or hang the libraries that read HDF5 and MATLAB files, and a few kilobytes
can unpack to many gigabytes. What comes back from the child are plain numbers of a known type and shape.
"""

from __future__ import annotations

import json
from functools import cached_property
from io import BufferedReader
from pathlib import Path
from types import TracebackType
from typing import Any, Self, cast

import numpy as np
from numpy.typing import NDArray

from campaigns.log.child import Limited, start_python, time_limit_s
from sim_backend.errors import DataError

CHILD = "from campaigns.importing.foreign import child; child()"


class IsolatedSource:
    """A file of one of the kinds in `foreign` at `path`; close it or use it as a context manager."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._limit_s = time_limit_s(path)
        self._child = Limited(start_python(CHILD, str(path.absolute()), talk=True))
        self._told: dict[str, dict[str, Any]] = {}

    def names(self) -> list[str]:
        """Return the names at the top of the file; raises DataError when it is damaged."""
        return self._names

    def array(self, name: str) -> NDArray[Any] | None:
        """Return the array of that name, any shape, None without one; raises DataError when it is refused."""
        said, values = self._ask(name)
        if "type" in said:
            raise DataError(f"{self.path}: '{name}' holds values of type {said['type']}: select real numbers")
        self._told[name] = said
        return values

    def unit(self, name: str) -> str | None:
        """Return the unit that the file names for an array that was read, None where it names none."""
        return cast("str | None", self._told.get(name, {}).get("unit"))

    def dated(self, name: str) -> bool:
        """Tell whether an array that was read holds dates, as nanoseconds since 1970."""
        return bool(self._told.get(name, {}).get("dated"))

    def close(self) -> None:
        """End the child."""
        self._child.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self.close()

    @cached_property
    def _names(self) -> list[str]:
        names: list[str] = self._ask(None)[0]["names"]
        return names

    def _ask(self, name: str | None) -> tuple[dict[str, Any], NDArray[Any] | None]:
        self._child.await_ready(self.path)
        try:
            with self._child.within(self._limit_s):
                return self._answer(name)
        except (OSError, EOFError, ValueError):
            raise self._child.why(self.path) from None

    def _answer(self, name: str | None) -> tuple[dict[str, Any], NDArray[Any] | None]:
        into, out = self._child.process.stdin, self._child.process.stdout
        assert into is not None and out is not None
        into.write(json.dumps(name).encode() + b"\n")
        into.flush()
        said: dict[str, Any] = json.loads(out.readline() or "nothing")
        if "refused" in said:
            raise DataError(said["refused"])
        if "dtype" not in said:
            return said, None
        values = np.empty(said["shape"], said["dtype"])
        if values.nbytes and cast(BufferedReader, out).readinto(_bytes_of(values)) != values.nbytes:
            raise EOFError
        return said, values.T if said["turned"] else values


def _bytes_of(values: NDArray[Any]) -> memoryview:
    return values.reshape(-1).view(np.uint8).data
