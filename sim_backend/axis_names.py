"""The names of the axes as a reader knows them; commands, logs and models have them in plain letters."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

AXES: Final[Mapping[str, str]] = MappingProxyType({"theta_x": "θx", "theta_y": "θy", "theta_z": "θz"})


def axis_text(name: str) -> str:
    """Return the name of an axis as it is printed: θx for `theta_x`, any other as it is."""
    return AXES.get(name, name)


_NAME = "|".join(AXES)
_IN_TEXT = re.compile(rf"(?<![\w./-])(?<!--axis )({_NAME})(?:->({_NAME}))?(?![\w/]|\.\w|-)")


def with_axes(text: str) -> str:
    """Return `text` with axes, and arrows between them, as they are printed.

    What is part of the name of a file without spaces, or given to `--axis`, stays as it is typed.
    """
    return _IN_TEXT.sub(lambda found: "→".join(AXES[name] for name in found.groups() if name), text)


def axes_in(value: Any) -> Any:
    """Return lists, tuples and dicts with the axes in their texts as they are printed; keys, and all else, stay."""
    if isinstance(value, str):
        return with_axes(value)
    if isinstance(value, list | tuple):
        return [axes_in(one) for one in value]
    return {key: axes_in(one) for key, one in value.items()} if isinstance(value, dict) else value
