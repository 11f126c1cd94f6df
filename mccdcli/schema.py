"""The JSON Schema of what each command prints with --json, made from `results.toml`."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterable
from functools import cache
from importlib import resources
from typing import Any, Final

from sim_backend.errors import ConfigError, did_you_mean

DRY_RUN: Final = "a dry run"
_TYPES: Final[dict[str, dict[str, Any]]] = {
    "text": {"type": "string"},
    "integer": {"type": "integer"},
    "number": {"type": "number"},
    "flag": {"type": "boolean"},
    "object": {"type": "object"},
    "list": {"type": "array"},
    "numbers": {"type": "array", "items": {"type": ["number", "null", "array"]}},
    "any": {},
}
_STEP: Final = re.compile(r"(?P<name>[^.\[{?]*)(?P<optional>\??)(?P<inside>(?:\[\]|\{\})*)")


@cache
def _results() -> dict[str, dict[str, str]]:
    text = (resources.files("mccdcli") / "results.toml").read_text(encoding="utf-8")
    tables: dict[str, dict[str, str]] = tomllib.loads(text)
    return tables


def names() -> list[str]:
    """Return the commands that have a schema, in the order of their names."""
    return sorted(name for name in _results() if not name.startswith("a "))


def schema_of(command: str, *, dry_run: bool = False) -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of a command's result; with `dry_run`, either that or a dry run's.

    Raises ConfigError for a command without one.
    """
    if command not in names():
        near = did_you_mean(command, names())
        raise ConfigError(f"there is no JSON of '{command}'; {near}there is of {', '.join(names())}")
    result = _object(command)
    shape = {"anyOf": [result, _object(DRY_RUN)]} if dry_run else result
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": f"mccd {command} --json", **shape}


def described(command: str) -> str:
    """Return the result of a command as Markdown: every value with its type and meaning."""
    return f"## mccd {command}\n\n{as_table(values_of(command))}"


def values_of(command: str) -> list[tuple[str, str, str]]:
    """Return path, type and meaning of every value of a command's result; `?` stands behind what may be absent."""
    flat = ((place, *meaning.partition(":")) for place, meaning in _flat(command).items())
    return [(place, kind, meaning.strip()) for place, kind, _, meaning in flat]


def as_table(values: Iterable[tuple[str, str, str]]) -> str:
    """Return values, each with its path, type and meaning, as a table of Markdown."""
    rows = [f"| `{place}` | {kind} | {meaning} |" for place, kind, meaning in values]
    return "\n".join(["| value | type | meaning |", "|---|---|---|", *rows])


def _flat(table: str, above: str = "") -> dict[str, str]:
    """Return all paths of a table, those that it inherits included, behind `above`."""
    found: dict[str, str] = {}
    for place, meaning in _results()[table].items():
        head, _, last = place.rpartition(".")
        if last == "like":
            found |= _flat(meaning, f"{above}{head}." if head else above)
        else:
            found[above + place] = meaning
    return found


def _object(table: str) -> dict[str, Any]:
    root: dict[str, Any] = {}
    for place, meaning in _flat(table).items():
        kind, _, text = meaning.partition(": ")
        node, optional = root, kind.endswith("?")
        steps = [match for match in (_STEP.fullmatch(step) for step in place.split(".")) if match is not None]
        for i, step in enumerate(steps):
            may_miss = bool(step["optional"]) or (optional and i == len(steps) - 1)
            node = _member(node, step["name"], may_miss)
            for inside in re.findall(r"\[\]|\{\}", step["inside"]):
                node = _inside(node, inside)
        node |= _typed(kind.removesuffix("?")) | {"description": text}
    return root


def _member(node: dict[str, Any], name: str, may_miss: bool) -> dict[str, Any]:
    """Return the schema of a named member of an object, which has no others than those that are named."""
    node.setdefault("type", "object")
    node.setdefault("additionalProperties", False)
    member: dict[str, Any] = node.setdefault("properties", {}).setdefault(name, {})
    required = node.setdefault("required", [])
    if not may_miss and name not in required:
        required.append(name)
    return member


def _inside(node: dict[str, Any], inside: str) -> dict[str, Any]:
    """Return the schema of what is in a list or in an object whose names are data."""
    node["type"], place = ("array", "items") if inside == "[]" else ("object", "additionalProperties")
    below: dict[str, Any] = node.setdefault(place, {})
    return below


def _typed(kind: str) -> dict[str, Any]:
    if not kind.endswith(" or null"):
        return json.loads(json.dumps(_TYPES[kind]))
    return {**_TYPES[kind.removesuffix(" or null")], "type": [_TYPES[kind.removesuffix(" or null")]["type"], "null"]}
