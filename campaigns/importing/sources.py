"""Files that data can be imported from: one class per kind, all asked for arrays by name.

Text is read piece by piece, whatever it holds; all other kinds are parsed in a process of its own, see `isolated`.
"""

from __future__ import annotations

import difflib
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from campaigns.importing.isolated import IsolatedSource
from campaigns.importing.kinds import APART, SUFFIXES, TEXT, is_packaged, packaged
from campaigns.importing.selecting import column_of, parse_selection
from campaigns.importing.text import TextSource
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
        """Return the array of that name, any shape, None without one; raises DataError when it cannot be read."""

    def unit(self, name: str) -> str | None:
        """Return the unit that the file itself names for an array that was read, None where it names none."""


def open_source(
    path: Path,
    closing: ExitStack,
    separator: str | None = None,
    decimal: str | None = None,
    header: bool | None = None,
) -> Source:
    """Return the source for the file at `path` by its suffix; what it holds open is let go with `closing`.

    `separator`, `decimal` and `header` (whether the first line holds names) are found in the file where they are None.

    Raises DataError when the suffix is none of `SUFFIXES` and no other package reads it (`sim_backend.plugins`).
    """
    if not path.is_file():
        raise DataError(f"source {path} is not a file: check the path, which counts from the map's folder")
    kind = path.suffix.lower()
    if kind in TEXT:
        return TextSource(path, separator, decimal, header)
    if kind in APART or is_packaged(path):
        return closing.enter_context(IsolatedSource(path))
    raise DataError(f"source {path} has the suffix '{kind}': readable are {', '.join((*SUFFIXES, *packaged()))}")


def variable_of(source: Source, text: str) -> str:
    """Return which variable `select = text` is of; a name that is there as it stands wins over indices."""
    return text if text in source.names() else parse_selection(text).name


def select(source: Source, text: str) -> AnyArray:
    """Return what `select = text` means in `source`; a name that is there as it stands wins over indices.

    The array may have any shape. Raises DataError naming what there is instead, ConfigError for indices that do not
    fit.
    """
    whole = source.array(text) if text in source.names() else None
    if whole is not None:
        return whole
    selection = parse_selection(text)
    number = column_of(selection)
    if isinstance(source, TextSource) and number is not None:
        return np.asarray(source.array(source.column(number)))  # whatever the other columns hold
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
