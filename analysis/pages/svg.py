"""An SVG file adapted for use inside a page: no prolog, names of its own, and the page's colours."""

from __future__ import annotations

import re

from analysis.pages.canvas import COLOURS, INK, QUIET

_NAME = re.compile(r'\bid="([^"]+)"')
_TAG = re.compile(r"<[a-z][^<>]*>")
_STYLE = re.compile(r'\sstyle="([^"]*)"')
_FOR_ALL = '<style type="text/css">*{stroke-linejoin: round; stroke-linecap: butt}</style>'
_INHERITED = 'stroke-linejoin="round" stroke-linecap="butt"'
"""What Matplotlib says of all elements of a figure, and the same as what they inherit."""


def inlined(svg: str, prefix: str, title: str) -> str:
    """Return the `<svg>` element of a figure, its ids behind `prefix`, its colours those of the page."""
    start = svg.index("<svg")
    body = svg[start:]
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = _TAG.sub(_with_attributes, body.replace(_FOR_ALL, ""))
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
    return body.replace("<svg", f'<svg role="img" aria-label="{title}" {_INHERITED}', 1)


def _with_attributes(tag: re.Match[str]) -> str:
    """Return a tag with its style as attributes, which mean the same: a page allows no style but its own."""
    found = _STYLE.search(tag[0])
    if found is None:
        return tag[0]
    rules = (rule.partition(":") for rule in found[1].split(";") if rule.strip())
    attributes = {name.strip(): value.strip() for name, _, value in rules}
    written = "".join(f' {name}="{value}"' for name, value in attributes.items())
    return f"{tag[0][: found.start()]}{written}{tag[0][found.end() :]}"
