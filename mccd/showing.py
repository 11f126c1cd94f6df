"""What the results have in common: how they show themselves in a notebook, and libraries that may be absent."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from markupsafe import Markup, escape

from sim_backend.errors import ConfigError

if TYPE_CHECKING:
    import pandas as pd


def as_html(title: str, lines: list[str], frame: pd.DataFrame | None = None) -> str:
    """Return a heading, lines of text and a table as HTML; the content of files is text there, never markup."""
    parts = [Markup("<b>{}</b>").format(title), *(Markup("<p>{}</p>").format(line) for line in lines)]
    if frame is not None and len(frame):
        parts.append(Markup(frame.to_html(escape=True, float_format="{:.5g}".format, border=0)))
    return str(Markup("\n").join(escape(part) for part in parts))


def xarray() -> Any:
    """Return the library xarray; raises ConfigError where it is not installed."""
    try:
        return import_module("xarray")
    except ImportError:
        raise ConfigError("xarray is not installed; install it with `pip install 'mccd[exchange]'`") from None
