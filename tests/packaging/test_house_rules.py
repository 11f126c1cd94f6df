"""The rules of the house that no linter holds: sizes, and words that do not belong into the sources."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PRODUCT = ("sim_backend", "campaigns", "analysis", "mccd", "mccdcli")
FILE_LINES = 400
FUNCTION_LINES = 60


def sources(*folders: str) -> list[str]:
    paths = (path for folder in folders for path in (ROOT / folder).rglob("*.py"))
    return sorted(str(path.relative_to(ROOT)) for path in paths)


def functions(source: str) -> Iterator[tuple[str, int]]:
    """Yield the name and the number of lines of each function, nested ones too."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            assert node.end_lineno is not None
            yield node.name, node.end_lineno - node.lineno + 1


def test_lines_are_counted_from_def_to_the_last() -> None:
    source = "@wrapped\ndef f():\n    def g():\n        return 1\n    return g\n\n\nx = 1\n"
    assert dict(functions(source)) == {"f": 4, "g": 2}


def matches(pattern: str) -> list[str]:
    """Return "file: text" for each match of `pattern` in the product's sources."""
    return [f"{n}: {m[0]}" for n in sources(*PRODUCT) for m in re.finditer(pattern, (ROOT / n).read_text())]


def test_a_file_holds_one_idea() -> None:
    lines = {name: (ROOT / name).read_text().count("\n") for name in sources(*PRODUCT, "benchmarks", "tests")}
    assert {name: n for name, n in lines.items() if n > FILE_LINES} == {}


def test_a_function_does_one_thing() -> None:
    lengths = {
        f"{name}: {function}": n
        for name in sources(*PRODUCT, "benchmarks")
        for function, n in functions((ROOT / name).read_text())
    }
    assert {function: n for function, n in lengths.items() if n > FUNCTION_LINES} == {}


def test_nothing_is_left_for_later_and_nothing_is_hidden_from_coverage() -> None:
    assert matches(r"\b(?:TODO|FIXME|XXX)\b|pragma: no cover") == []


def slugs(source: str) -> Iterator[str]:
    """Yield each expression of an f-string that writes the slug of an effect as it is."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FormattedValue) and _is_slug(node.value):
            yield ast.unparse(node.value)


def _is_slug(node: ast.expr) -> bool:
    match node:
        case ast.Call(func=ast.Attribute(attr="join"), args=[ast.GeneratorExp(elt=one)]):
            return _is_slug(one)
        case ast.Call(func=ast.Attribute(attr="reported")) | ast.Attribute(attr="effect"):
            return True
        case ast.Attribute(value=ast.Attribute(attr="effect"), attr="name"):
            return True
    return False


def test_slugs_are_found_where_they_are_written() -> None:
    written = (
        """f"{c.effect.name} or {e.reported()} or {' and '.join(e.effect for e in all)}, {effect_text(c.effect)}" """
    )
    assert sorted(slugs(written)) == ["' and '.join((e.effect for e in all))", "c.effect.name", "e.reported()"]


def test_sentences_have_effects_in_words() -> None:
    """What the diagnosis says goes through `sim_backend.effects.words`; slugs are for files, options and keys."""
    keys = {
        "analysis/diagnosis/answer/changes.py": ["entry.effect"],  # `place` of a parameter in diagnosis.json
    }
    found = {name: list(slugs((ROOT / name).read_text())) for name in sources("analysis/diagnosis")}
    assert {name: one for name, one in found.items() if one} == keys


def test_no_source_names_a_folder_of_one_machine() -> None:
    assert matches(r"""["'\s]/(?:home|root|Users|work)/""") == []


def test_no_file_is_a_drawer() -> None:
    drawers = {"utils.py", "util.py", "helpers.py", "misc.py", "common.py"}
    assert [name for name in sources(*PRODUCT) if Path(name).name in drawers] == []


def test_files_are_written_by_the_one_module_that_follows_no_link() -> None:
    direct = (
        r"\.write_(?:text|bytes)\(|open\((?!\d)[^)\n]*[\"'][rwax]*b?[wax+]+b?[\"']|mkstemp\(|NamedTemporaryFile\(|\.truncate\("
        r"|\.savefig\((?!stream|buffer)|\.to_csv\((?!file\b|index|\))|np\.save(?:z|txt)?\((?!file\b)|h5py\.File\([^)]*[\"']w"
    )
    allowed = {
        "safe_write.write_text(",
        "open(os.devnull",
        'archive.open(f"{name}.npy", "w"',
        'archive.open("about.npy", "w"',
    }
    found = [
        f"{name}: {line.strip()}"
        for name in sources(*PRODUCT)
        if name != "sim_backend/safe_write.py"
        for line in (ROOT / name).read_text().splitlines()
        if re.search(direct, line) and not any(known in line for known in allowed)
    ]
    assert found == []
