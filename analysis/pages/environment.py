"""The templates of a page: its own folder first, then what all pages share, with the filters that all use."""

from __future__ import annotations

from typing import TYPE_CHECKING

from markupsafe import Markup

from analysis.pages.formats import exact, shown

if TYPE_CHECKING:
    import jinja2


def page_environment(package: str) -> jinja2.Environment:
    """Return the environment of the templates in `package`; every value is escaped, and a missing one is an error."""
    import jinja2  # with the first page, not with the first option that is read

    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(p, "templates") for p in (package, "analysis.pages")]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["shown"] = shown
    environment.filters["exact"] = exact
    environment.filters["embedded"] = embedded
    return environment


def embedded(value: object) -> Markup:
    """Return `value` as JSON that may stand in a script element: without `<`, `>` and `&`, finite numbers only."""
    from jinja2.utils import htmlsafe_json_dumps

    return htmlsafe_json_dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
