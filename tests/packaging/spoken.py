"""What the sources say to people: messages, help texts, captions, templates; also pages and docstrings."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.docs.test_pages import PAGES

ROOT = Path(__file__).parents[2]
DOCS = (
    "README.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "mccdcli/results.toml",
    "benchmarks/README.md",
    "benchmarks/results/README.md",
)
"""Texts outside of docs/ that people read."""

PRODUCT = ("sim_backend", "campaigns", "analysis", "mccd", "mccdcli")


def strings(source: str, *, help_texts: bool = False) -> Iterator[tuple[int, str]]:
    """Yield line and text of each string of two words or more; docstrings of functions only as `help_texts`."""
    tree = ast.parse(source)
    silent: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr):
            is_help = help_texts and any(
                isinstance(f, ast.FunctionDef) and f.decorator_list and f.body and f.body[0] is node
                for f in ast.walk(tree)
            )
            if not is_help:
                silent.add(id(node.value))
        if isinstance(node, ast.JoinedStr):
            silent.update(id(part) for part in node.values)
    for node in ast.walk(tree):
        if id(node) in silent:
            continue
        if isinstance(node, ast.JoinedStr):
            text = "".join(str(part.value) if isinstance(part, ast.Constant) else "…" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            text = node.value
        else:
            continue
        if re.search(r"\w\S* +\S*\w", text):
            yield node.lineno, text


def template_text(source: str) -> str:
    """Return what a template shows: without tags, scripts, styles and instructions."""
    bare = re.sub(r"<(script|style)\b.*?</\1>|\{#.*?#\}", " ", source, flags=re.DOTALL)
    return re.sub(r"\{%.*?%\}|\{\{.*?\}\}|<[^>]*>", lambda m: "\n" * m[0].count("\n") or " ", bare, flags=re.DOTALL)


def said() -> Iterator[tuple[str, str]]:
    """Yield "file:line" and the text of all that the product says."""
    for folder in PRODUCT:
        for path in sorted((ROOT / folder).rglob("*.py")):
            name = str(path.relative_to(ROOT))
            for line, text in strings(path.read_text(encoding="utf-8"), help_texts=folder == "mccdcli"):
                yield f"{name}:{line}", text
        for path in sorted((ROOT / folder).rglob("*.j2")):
            name = str(path.relative_to(ROOT))
            for line, text in enumerate(template_text(path.read_text(encoding="utf-8")).splitlines(), 1):
                yield f"{name}:{line}", text
        for path in sorted((ROOT / folder).rglob("*.toml")):
            for text in toml_texts(tomllib.loads(path.read_text(encoding="utf-8"))):
                yield str(path.relative_to(ROOT)), text


def toml_texts(node: Any) -> Iterator[str]:
    """Yield each string of two words or more among the values of a TOML file: notes, reasons and titles on pages."""
    if isinstance(node, dict | list):
        for one in node.values() if isinstance(node, dict) else node:
            yield from toml_texts(one)
    elif isinstance(node, str) and re.search(r"\w\S* +\S*\w", node):
        yield node


def docstrings(source: str) -> Iterator[tuple[int, str]]:
    """Yield line and text of each docstring, those of values among them, as one line and without `names`."""
    for node in ast.walk(ast.parse(source)):
        body = getattr(node, "body", None)
        for one in body if isinstance(body, list) else ():
            if isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant) and isinstance(one.value.value, str):
                yield one.lineno, _without_names(one.value.value)


def prose(page: str) -> Iterator[tuple[int, str]]:
    """Yield line and text of each paragraph of a page, as one line; code, names, comments and targets are left out."""
    bare = re.sub(r"^```.*?^```$|<!--.*?-->", lambda m: "\n" * m[0].count("\n"), page, flags=re.DOTALL | re.MULTILINE)
    line = 1
    for part in re.split(r"(\n(?:[ \t]*\n)+|\n(?=[-|] ))", bare):
        yield line, re.sub(r"\]\([^)]*\)", "]", _without_names(part))
        line += part.count("\n")


def _without_names(text: str) -> str:
    return " ".join(re.sub(r"(`+)[^`]+\1", "…", text).split())


def written() -> Iterator[tuple[str, str]]:
    """Yield "file:line" and the text of each paragraph of the pages and of each docstring of the product."""
    for path in (*(ROOT / "docs" / name for name in PAGES), *(ROOT / name for name in DOCS)):
        for line, text in prose(path.read_text(encoding="utf-8")):
            yield f"{path.relative_to(ROOT)}:{line}", text
    for folder in PRODUCT:
        for path in sorted((ROOT / folder).rglob("*.py")):
            for line, text in docstrings(path.read_text(encoding="utf-8")):
                yield f"{path.relative_to(ROOT)}:{line}", text
