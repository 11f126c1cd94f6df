"""The page of a comparison: its tables, the values that differ marked, and its figures, in one self-contained file."""

from __future__ import annotations

from pathlib import Path

from markupsafe import Markup, escape

from analysis.comparison.table import Comparison
from analysis.pages.environment import page_environment
from analysis.pages.svg import inlined
from campaigns.version import tool_commit, tool_version
from sim_backend.safe_write import require_new_or_own, write_text

GENERATOR = b'<meta name="generator" content="mccd compare">'
"""The line of the template by which such a page is recognised."""


def require_page(path: Path) -> None:
    """Raise ConfigError where a page would replace anything but an earlier page, such as a file that is compared.

    Raises OSError where its folder is not writable.
    """
    require_new_or_own(path, lambda begin: GENERATOR in begin, "page of `mccd compare`")


def write_comparison(found: Comparison, path: Path) -> Path:
    """Write the page, replacing one of that name, and return its path; raises as `require_page`."""
    require_page(path)
    drawings = [
        (canvas, Markup(inlined(canvas.svg(), f"c{i}", str(escape(canvas.title)))))
        for i, canvas in enumerate(found.figures)
    ]
    page = page_environment("analysis.comparison").get_template("comparison.html.j2")
    text = page.render(found=found, drawings=drawings, version=f"{tool_version()} ({tool_commit()})")
    return write_text(path, str(text))
