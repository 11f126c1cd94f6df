"""A page on paper: the PDF of a page that was written, with its figures in the light colours."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path
from typing import Any

from sim_backend.errors import ConfigError
from sim_backend.safe_write import whole_file

_COLOUR = re.compile(r"(--[\w-]+):\s*([^;}]+)")
_USED = re.compile(r"var\((--[\w-]+)\)")


def require_pdf() -> None:
    """Raise ConfigError where no PDF can be made: to be asked before anything is measured."""
    _weasyprint()


def write_pdf(page: Path, target: Path) -> Path:
    """Write the PDF of the HTML at `page` to `target` and return this; raises ConfigError as `require_pdf` does.

    What can only be clicked is left out.
    """
    weasyprint = _weasyprint()
    text = page.read_text(encoding="utf-8")
    sheet = resources.files("analysis.pages").joinpath("templates/paper.css").read_text("utf-8")
    text = text.replace("</head>", f"<style>{sheet}</style></head>", 1)
    # drawings inside a page do not see its variables; a base address would put the paths of this computer into links
    own = weasyprint.urls.URLFetcher(allowed_protocols={"data"})  # what a page may load is in it
    drawn = weasyprint.HTML(string=_with_colours(text), url_fetcher=own).write_pdf()
    with whole_file(target) as file:
        file.write(drawn)
    return target


def _weasyprint() -> Any:
    try:
        import weasyprint.urls
    except ImportError:
        raise ConfigError("a PDF needs WeasyPrint: install it with pip install 'mccd[pdf]'") from None
    except OSError as error:  # it is there, and a library of the system that it loads is not
        raise ConfigError(
            f"a PDF needs Pango, a library of the system, and it cannot be loaded ({str(error).splitlines()[0]}): "
            "install it (Debian and Ubuntu: apt install libpango-1.0-0 libpangoft2-1.0-0)"
        ) from None
    return weasyprint


def _with_colours(text: str) -> str:
    """Return a page with the names of colours replaced by colours: those of paper, else the light ones."""
    light, _, paper = text.partition("@media print {")
    colours = dict(_COLOUR.findall(light[light.index(":root {") : light.index("}")]))
    colours |= dict(_COLOUR.findall(paper[: paper.index("}")]))
    return _USED.sub(lambda used: colours.get(used[1], used[0]), text)
