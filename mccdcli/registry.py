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
GROUPS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "log": "Show, verify and recover logs.",
    }
)

COMMANDS: Final[Mapping[str, Entry]] = MappingProxyType(
    {
        "completion": Entry(
            "mccdcli.commands.completion:completion", "Print the script that completes mccd in your shell."
        ),
        "import": Entry(
            "mccdcli.commands.import_data:import_data",
            "Import data of any bench into a log, as a map file describes them.",
        ),
        "log recover": Entry(
            "mccdcli.commands.log_recover:recover",
            "Recover what a crash left of a log into a new file, marked as crashed.",
        ),
        "log show": Entry(
            "mccdcli.commands.log_show:show",
            "Show what a log holds: its run, its channels and its segments.",
        ),
        "log verify": Entry(
            "mccdcli.commands.log_verify:verify",
            "Verify that logs are as they were written; exit code 1 if one is not.",
        ),
    }
)
