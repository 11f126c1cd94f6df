"""The names of the axes as a reader knows them; commands, logs and models have them in plain letters."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

AXES: Final[Mapping[str, str]] = MappingProxyType({"theta_x": "θx", "theta_y": "θy"})


def axis_text(name: str) -> str:
    """Return the name of an axis as it is printed: θx for `theta_x`, any other as it is."""
    return AXES.get(name, name)


_IN_TEXT = re.compile(rf"(?<![\w./-])({'|'.join(AXES)})(?![\w/]|\.\w|-[^>])")


def with_axes(text: str) -> str:
    """Return `text` with axes, and arrows between them, as they are printed; what is part of a file's name stays."""
    return _IN_TEXT.sub(lambda found: AXES[found[1]], text).replace("->", "→")
