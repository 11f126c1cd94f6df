"""The docstring of every public function that takes or returns an array says what shape it has."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("analysis", "sim_backend", "campaigns", "mccd")

ARRAY = re.compile(r"\b(?:\w*Array|ArrayLike|Ints|Mask)\b")
"""An annotation that is an array or holds some."""

SIZES = (
    "axes|axis|bands|bins|blocks|channels?|columns|cycles|draws|dwell|experiments?|group|inputs|lanes|lines|modes"
    "|nuisances|order|outputs|periods?|points|realisations?|rows|runs|samples|segments|states|substeps|trials|tuned|window"
)
"""Words that stand for a number of entries in a shape, beside letters (n, n_y)."""

_ATOM = rf"(?:\d+[a-z]?|[a-zA-Z](?:_\w+)?|[a-z]\d|{SIZES}|…|\.\.\.)"
_ENTRY = rf"{_ATOM}(?:(?: | ?[-+·*] ?| ?//? ?){_ATOM})*"
SHAPE = re.compile(
    rf"\([\w+ ]+,\)|\({_ENTRY}(?:, ?{_ENTRY})+\)|\d × \d|\bshape \("
    r"|\b[Ss]calars?\b|\bany shape\b|\b(?:same|own) shape\b|\bof the shape of\b"
    r"|\b(?:[Ss]ee|as in|as of|[Ss]hapes? as|[Aa]rguments of|shapes are) `[\w.]+`"
)
"""A shape; or that there is only a number; or where it is described: see, as in, something with a name."""


def functions(source: str) -> Iterator[tuple[str, str, ast.FunctionDef]]:
    """Yield class ("" of none), its bases, and each public function of a module and method of a public class."""
    for node in ast.parse(source).body:
        if isinstance(node, ast.FunctionDef):
            yield "", "", node
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            bases = " ".join(ast.unparse(base) for base in node.bases)
            for method in node.body:
                if isinstance(method, ast.FunctionDef):
                    yield node.name, bases, method


def with_arrays(function: ast.FunctionDef) -> bool:
    arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    said = [argument.annotation for argument in arguments] + [function.returns]
    return any(ARRAY.search(ast.unparse(one)) for one in said if one is not None)


def says_shape(function: ast.FunctionDef) -> bool:
    return bool(SHAPE.search(" ".join((ast.get_docstring(function) or "").split())))


@cache
def every() -> list[tuple[str, str, str, ast.FunctionDef]]:
    return [
        (f"{path.relative_to(ROOT)}:{function.lineno} {function.name}", name, bases, function)
        for folder in FOLDERS
        for path in sorted((ROOT / folder).rglob("*.py"))
        for name, bases, function in functions(path.read_text(encoding="utf-8"))
        if not function.name.startswith("_")
    ]


def without_shape() -> list[str]:
    """Return the functions that do not say the shape, nor have a base whose method of that name does."""
    described = {(name, function.name) for _, name, _, function in every() if name and says_shape(function)}
    bases: dict[str, set[str]] = {}
    for _, name, known, _ in every():
        bases.setdefault(name, set()).update(re.findall(r"\w+", known))

    def inherited(name: str, method: str, seen: frozenset[str] = frozenset()) -> bool:
        above = bases.get(name, set()) - seen
        return any((base, method) in described or inherited(base, method, seen | {name}) for base in above)

    return [
        where
        for where, name, _, function in every()
        if with_arrays(function) and not says_shape(function) and not (name and inherited(name, function.name))
    ]


def test_every_public_function_says_the_shape_of_its_arrays() -> None:
    assert sum(with_arrays(function) for *_, function in every()) > 500
    assert without_shape() == []


@pytest.mark.parametrize(
    ("docstring", "says"),
    [
        ("Return the response.", False),
        ("Return the causes (hysteresis, friction) of a record.", False),
        ("Return the torques (n, n_u) in N m.", True),
        ("Return the columns (2 n + 1, k).", True),
        ("Return the matrix (2, m, 2, 2).", True),
        ("Return the 2 × 2 matrix of a block.", True),
        ("Return S of a response, any shape.", True),
        ("Return the errors, see `errors_of`.", True),
        ("Return the sum of a product, a scalar.", True),
    ],
)
def test_a_shape_is_recognised(docstring: str, says: bool) -> None:
    (_, _, function) = next(functions(f'def f(a: Array) -> Array:\n    """{docstring}"""\n'))
    assert with_arrays(function) and says_shape(function) is says
