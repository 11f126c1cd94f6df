"""Places in a model file: `modes[theta_y suspension].frequency_hz` and the like, found and replaced.

A place is the path to a number as the file is written, its parts separated by dots. An entry of a list is chosen in
brackets: a mode by its label, an effect as `name@where`. `*` and `?` stand for any characters, in keys too, so that one
place may mean many numbers.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

from sim_backend.errors import ConfigError, did_you_mean

_STEP = re.compile(r"(?P<key>[^.\[\]]+)(?:\[(?P<label>[^\]]*)\])?(?:\.|$)")

Way = tuple[str | int, ...]


@dataclass(frozen=True)
class Number:
    """One number of a model: its `name` as a place without wildcards, the keys that lead to it, and its value."""

    name: str
    way: Way
    value: float


def numbers_at(content: Mapping[str, Any], place: str) -> list[Number]:
    """Return every number of a model's plain content that `place` means, in the order of the file.

    Raises ConfigError when there is none, naming what is there where the path ends.
    """
    found = list(_followed(content, _steps(place), (), ()))
    if not found:
        raise ConfigError(f"place 'model.{place}': {_missing(content, place)}")
    seen: Counter[str] = Counter()
    numbers = []
    for names, way, value in found:
        name = ".".join(names)
        seen[name] += 1  # two modes may have one label
        numbers.append(Number(name if seen[name] == 1 else f"{name}#{seen[name]}", way, value))
    return numbers


def replaced(content: Any, way: Way, value: float) -> Any:
    """Return the content with the number at the end of `way` replaced; what is not on this path is shared."""
    if not way:
        return {**content, "value": value} if isinstance(content, dict) else value
    copy = content.copy()
    copy[way[0]] = replaced(content[way[0]], way[1:], value)
    return copy


def _steps(place: str) -> list[tuple[str, str | None]]:
    steps, at = [], 0
    while at < len(place):
        match = _STEP.match(place, at)
        if match is None:
            raise ConfigError(
                f"place 'model.{place}' cannot be read from '{place[at:]}' on; write it as in "
                "model.modes[theta_y suspension].frequency_hz"
            )
        steps.append((match["key"], match["label"]))
        at = match.end()
    return steps


def _followed(
    node: Any, steps: list[tuple[str, str | None]], names: tuple[str, ...], way: Way
) -> Iterator[tuple[tuple[str, ...], Way, float]]:
    if not steps:
        value = node.get("value") if isinstance(node, Mapping) else node
        if isinstance(value, int | float) and not isinstance(value, bool):
            yield names, way, float(value)
        return
    (key, label), rest = steps[0], steps[1:]
    if not isinstance(node, Mapping):
        return
    for own in (key,) if key in node else tuple(k for k in node if fnmatchcase(k, key)):
        below = node[own]
        if isinstance(below, list):
            for i, entry in enumerate(below):
                if label is not None and fnmatchcase(_label(entry), label):
                    yield from _followed(entry, rest, (*names, f"{own}[{_label(entry)}]"), (*way, own, i))
        elif label is None:
            yield from _followed(below, rest, (*names, own), (*way, own))


def _label(entry: Any) -> str:
    """Return what an entry of a list is chosen by."""
    if not isinstance(entry, Mapping):
        return ""
    if "effect" in entry:
        return f"{entry['effect']}@{entry['where']}"
    return str(entry.get("label", entry.get("name", "")))


def _missing(content: Mapping[str, Any], place: str) -> str:
    """State where the path of a place ends, and what there is instead."""
    nodes: list[Any] = [content]
    for key, label in _steps(place):
        known = sorted({k for node in nodes if isinstance(node, Mapping) for k in node})
        below = [node[k] for node in nodes if isinstance(node, Mapping) for k in node if fnmatchcase(k, key)]
        if not below:
            return f"there is no '{key}'; {did_you_mean(key, known)}there is {', '.join(known) or 'nothing below it'}"
        entries = [entry for one in below if isinstance(one, list) for entry in one]
        if label is None and entries:
            return f"'{key}' is a list; choose an entry in brackets: {', '.join(map(_label, entries))}"
        nodes = [e for e in entries if fnmatchcase(_label(e), label)] if label is not None else below
        if not nodes:
            labels = [_label(entry) for entry in entries]
            near = did_you_mean(label or "", labels)
            return f"no entry of '{key}' is '{label}'; {near}there is {', '.join(labels) or 'none'}"
    return "that is not a number; go on to one below it"
