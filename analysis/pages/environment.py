"""The templates of a page: its own folder first, then what all pages share, with the filters that all use."""

from __future__ import annotations

import base64
import hashlib
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING, Final

from markupsafe import Markup

from analysis.pages.formats import exact, printed, shown
from sim_backend.axis_names import axes_in

if TYPE_CHECKING:
    import jinja2

NOTHING: Final = "'none'"


def page_environment(package: str) -> jinja2.Environment:
    """Return the environment of the templates in `package`.

    Every value is escaped, text prints axes and numbers as a reader knows them, and a missing value is an error.
    """
    import jinja2  # with the first page, not with the first option that is read

    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(p, "templates") for p in (package, "analysis.pages")]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda value: printed(value) if type(value) is str else value,
    )
    environment.filters["shown"] = shown
    environment.filters["exact"] = exact
    environment.filters["embedded"] = embedded
    own = _OwnElements(environment)
    environment.globals |= {"element": own.element, "policy": own.policy}
    return environment


@dataclass(frozen=True)
class _OwnElements:
    """The scripts and styles of the pages, from files of the package alone: what a browser may run and apply.

    Their digests are taken from the files, never from a finished page: an injected script has none.
    """

    environment: jinja2.Environment

    def element(self, name: str) -> Markup:
        """Return the file `name` (.js or .css) as an element."""
        kind = _kind(name)
        return Markup("<{0}>{1}</{0}>").format(kind, Markup(self._text(name)))

    def policy(self, *names: str, asks_its_server: bool = False) -> Markup:
        """Return the element that lets a page have these files and images that it holds itself, and nothing else.

        One that is served may also ask its own server for data.
        """
        digests: dict[str, list[str]] = {"script": [], "style": []}
        for name in names:
            digest = base64.b64encode(hashlib.sha256(self._text(name).encode()).digest()).decode()
            digests[_kind(name)].append(f"'sha256-{digest}'")
        allowed = [f"{kind}-src {' '.join(found) or NOTHING}" for kind, found in digests.items()]
        asked = ["connect-src 'self'"] if asks_its_server else []
        rules = [f"default-src {NOTHING}", *allowed, *asked, "img-src data:"]
        rules += [f"base-uri {NOTHING}", f"form-action {NOTHING}"]
        return Markup('<meta http-equiv="Content-Security-Policy" content="{}">').format(Markup("; ".join(rules)))

    def _text(self, name: str) -> str:
        return f"\n{self.environment.get_template(name).render()}\n"


def _kind(name: str) -> str:
    return {".css": "style", ".js": "script"}[PurePath(name).suffix]


def embedded(value: object) -> Markup:
    """Return `value` as JSON that is safe in a script element: without `<`, `>` and `&`, finite numbers only.

    Its texts are printed by the script, and have axes as a reader knows them.
    """
    from jinja2.utils import htmlsafe_json_dumps

    return htmlsafe_json_dumps(axes_in(value), allow_nan=False, ensure_ascii=False, separators=(",", ":"))
