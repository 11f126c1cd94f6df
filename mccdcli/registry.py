"""Every command of `mccd` with its line of help: the one list, read without importing any of them."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple


class Entry(NamedTuple):
    """Where a command lives (`module:attribute`) and its one line of help."""

    target: str
    help: str


# A name of two words ("log show") is a command in a group; the group needs a line in GROUPS.
GROUPS: Final[Mapping[str, str]] = MappingProxyType({})

COMMANDS: Final[Mapping[str, Entry]] = MappingProxyType(
    {
        "completion": Entry(
            "mccdcli.commands.completion:completion", "Print the script that completes mccd in your shell."
        ),
    }
)
