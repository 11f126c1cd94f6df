"""The names of the axes as a reader knows them; commands, logs and models have them in plain letters."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

AXES: Final[Mapping[str, str]] = MappingProxyType({"theta_x": "θx", "theta_y": "θy"})


def axis_text(name: str) -> str:
    """Return the name of an axis as it is printed: θx for `theta_x`, any other as it is."""
    return AXES.get(name, name)
