"""Files that an importer of another package reads (`mccd.importers`), in the child process of `foreign`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from campaigns.importing.pieces import Pieces, of_array
from campaigns.importing.refusals import unreadable
from sim_backend.errors import ConfigError, DataError
from sim_backend.plugins import load_plugin

Importer = Callable[[Path], Mapping[str, ArrayLike | tuple[ArrayLike, str]]]
"""From a file to its arrays by name, each alone or with the unit that the file names for it."""


def importer_of(path: Path) -> Importer:
    """Return what reads files with the suffix of `path`; raises DataError where the package cannot be imported."""
    try:
        found: Importer = load_plugin("importers", path.suffix.lower().removeprefix("."))
    except ConfigError as error:
        raise DataError(str(error)) from None
    return found


@dataclass(frozen=True)
class PackagedSource:
    """The arrays that an importer finds in a file."""

    path: Path

    def names(self) -> list[str]:
        """Return their names; raises DataError when the importer fails."""
        return list(self._found)

    def pieces(self, name: str) -> Pieces | None:
        """Return an array, None when there is none; raises DataError when the importer fails."""
        return of_array(self._found[name][0]) if name in self._found else None

    def unit(self, name: str) -> str | None:
        """Return the unit that the importer names for an array."""
        return self._found[name][1] if name in self._found else None

    @cached_property
    def _found(self) -> dict[str, tuple[NDArray[Any], str | None]]:
        try:
            return {str(name): _with_unit(value) for name, value in importer_of(self.path)(self.path).items()}
        except DataError:
            raise
        except Exception as error:  # the code of others fails in any way
            raise unreadable(self.path, error) from None


def _with_unit(value: ArrayLike | tuple[ArrayLike, str]) -> tuple[NDArray[Any], str | None]:
    if isinstance(value, tuple) and len(value) == 2 and isinstance(value[1], str):
        return np.asarray(value[0]), value[1]
    return np.asarray(value), None
