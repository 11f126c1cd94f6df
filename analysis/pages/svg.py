"""An SVG file made fit to stand inside a page: no prolog, names of its own, and the page's colours."""

from __future__ import annotations

import re

from analysis.pages.canvas import COLOURS, INK, QUIET

_NAME = re.compile(r'\bid="([^"]+)"')


def inlined(svg: str, prefix: str, title: str) -> str:
    """Return the `<svg>` element of a figure, its ids behind `prefix`, its colours those of the page."""
    start = svg.index("<svg")
    body = svg[start:]
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    for name in sorted(set(_NAME.findall(body)), key=len, reverse=True):
        own = f"{prefix}-{name}"
        body = body.replace(f'id="{name}"', f'id="{own}"')
        body = body.replace(f'"#{name}"', f'"#{own}"').replace(f"url(#{name})", f"url(#{own})")
    body = body.replace(INK, "currentColor").replace(QUIET, "var(--quiet)")
    for i, colour in enumerate(COLOURS, start=1):
        body = body.replace(colour, f"var(--curve-{i})")
    # width and height in points would fix the size; the view box alone lets the page scale it
    body = re.sub(r'(<svg\b[^>]*?) width="[^"]*"', r"\1", body, count=1)
    body = re.sub(r'(<svg\b[^>]*?) height="[^"]*"', r"\1", body, count=1)
    return body.replace("<svg", f'<svg role="img" aria-label="{title}"', 1)
