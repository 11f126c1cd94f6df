"""Effects, plans, strategies and importers of other packages, found by the entry points that these declare.

An installed package declares them in the groups `mccd.effects`, `mccd.plans`, `mccd.strategies` and `mccd.importers`
(docs/how-to/write-a-plugin.md). Nothing of it is imported before one of its names is asked for.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import cache
from typing import TYPE_CHECKING, Any

from sim_backend.errors import ConfigError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

PREFIX = "mccd."


def plugin_names(group: str, taken: Collection[str] = ()) -> tuple[str, ...]:
    """Return the names that packages declare in a group, sorted.

    Raises ConfigError for a name that two packages declare, or that is `taken` by mccd itself.
    """
    points = _points(group)
    for name in taken:
        if name in points:
            raise ConfigError(f"{_told(points[name])} has the name of one of mccd's own; rename it there")
    return tuple(points)


def load_plugin(group: str, name: str) -> Any:
    """Return what a package declares under a name; raises ConfigError where it cannot be imported."""
    point = _points(group)[name]
    try:
        return point.load()
    except (Exception, SystemExit) as error:  # the code of others fails in any way
        reason = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        raise ConfigError(f"{_told(point)} cannot be imported ({reason}); repair or uninstall the package") from None


def refusal(group: str, name: str, what: str) -> ConfigError:
    """Return the error for something of a package that is not what its group holds."""
    return ConfigError(f"{_told(_points(group)[name])} {what}; correct the package")


@cache
def _points(group: str) -> dict[str, EntryPoint]:
    from importlib.metadata import entry_points  # most commands ask for nothing of another package

    found: dict[str, EntryPoint] = {}
    for point in sorted(entry_points(group=PREFIX + group), key=lambda each: each.name):
        other = found.setdefault(point.name, point)
        if other.value != point.value:  # the same package may be found twice
            raise ConfigError(f"{_told(point)} is also declared by {_package(other)}; uninstall one of them")
    return found


def _told(point: EntryPoint) -> str:
    return f"'{point.name}' of the package {_package(point)} (entry point {point.group}, {point.value})"


def _package(point: EntryPoint) -> str:
    return point.dist.name if point.dist is not None else "unknown"
