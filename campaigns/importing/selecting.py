"""What `select` means: a variable's name, with indices in brackets where only a piece of it is meant."""

from __future__ import annotations

import re
from dataclasses import dataclass
from types import EllipsisType

from sim_backend.errors import ConfigError

Index = int | slice | EllipsisType
_SELECTION = re.compile(r"(?P<name>[^\[\]]*)\[(?P<indices>[^\[\]]*)\]")
_NUMBER = re.compile(r"[+-]?\d{1,15}")


@dataclass(frozen=True)
class Selection:
    """A variable `name` (empty: the only one there is) and the indices applied to it, as numpy applies them."""

    name: str
    indices: tuple[Index, ...]


def parse_selection(text: str) -> Selection:
    """Read `name` or `name[i, a:b, a:b:c, ...]`; nothing is evaluated.

    Raises ConfigError for anything else in the brackets.
    """
    found = _SELECTION.fullmatch(text.strip())
    if not found:
        return Selection(text.strip(), ())
    indices = tuple(_index(part.strip(), text) for part in found["indices"].split(","))
    if sum(index is ... for index in indices) > 1:
        raise ConfigError(f"select '{text}' holds '...' twice: use it once")
    return Selection(found["name"].strip(), indices)


def column_of(selection: Selection) -> int | None:
    """Return the number of the column that `[:, k]` selects of a table without a name, None for anything else."""
    indices = selection.indices
    if selection.name or len(indices) != 2 or indices[0] != slice(None) or not isinstance(indices[1], int):
        return None
    return indices[1]


def _index(part: str, text: str) -> Index:
    if part == "...":
        return ...
    if _NUMBER.fullmatch(part):
        return int(part)
    pieces = [piece.strip() for piece in part.split(":")]
    if len(pieces) in (2, 3) and all(piece == "" or _NUMBER.fullmatch(piece) for piece in pieces):
        bounds = [int(piece) if piece else None for piece in pieces]
        if len(bounds) == 2 or bounds[2] != 0:
            return slice(*bounds)
    raise ConfigError(f"select '{text}' has the index '{part}': use whole numbers and slices, as in 'u[:, 0]'")
