"""What is imported is declared, what is declared is pinned, and the pins name no place to fetch from."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, distribution, packages_distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = SETTINGS["project"]
OURS = {"sim_backend", "campaigns", "analysis", "mccdcli"}
EXTRAS = set(PROJECT["optional-dependencies"])
# one of them asks for an older numpy than all the others, and is pinned beside what it is tested with
LOCKS = {
    "constraints.txt": EXTRAS - {"peers-diagnosis"},
    "constraints-peers-diagnosis.txt": {"dev", "peers-diagnosis"},
}
# names that a distribution gives to its import, for those that need not be installed here
IMPORT_NAMES = {"myst_parser": "myst-parser", "distributed": "distributed", "dask": "distributed"}


def pins(lock: str = "constraints.txt") -> dict[str, str]:
    """Return the pinned version of each distribution in a file of constraints."""
    lines = (ROOT / lock).read_text().splitlines()
    pairs = (line.split("==") for line in lines if line and not line.startswith("#"))
    return {canonicalize_name(name): version for name, version in pairs}


def declared(*extras: str) -> dict[str, Requirement]:
    """Return the requirements of the project itself and of these extras, by name."""
    texts = [*PROJECT["dependencies"], *(t for e in extras for t in PROJECT["optional-dependencies"][e])]
    return {canonicalize_name(r.name): r for r in map(Requirement, texts)}


def imported(folder: str) -> dict[str, str]:
    """Return the outside modules imported anywhere below `folder`, each with a file that imports it."""
    found = {}
    for path in sorted((ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(), str(path))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                names = [node.module]
            for name in names:
                found[name.partition(".")[0]] = str(path.relative_to(ROOT))
    return {k: v for k, v in found.items() if k not in OURS | set(sys.stdlib_module_names) | {"tests", "benchmarks"}}


def closure(names: Iterator[str] | list[str]) -> set[str]:
    """Return `names` and all that they need, as far as it is installed here."""
    seen: set[str] = set()
    waiting = list(names)
    while waiting:
        name = canonicalize_name(waiting.pop())
        if name in seen:
            continue
        try:
            needs = distribution(name).requires or []
        except PackageNotFoundError:
            continue
        seen.add(name)
        for requirement in map(Requirement, needs):
            if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
                waiting.append(requirement.name)
    return seen


@pytest.mark.parametrize("lock", LOCKS)
def test_every_line_of_the_constraints_is_one_exact_pin_and_names_no_host(lock: str) -> None:
    for line in (ROOT / lock).read_text().splitlines():
        assert line.startswith("#") or re.fullmatch(r"[A-Za-z0-9][\w.-]*==[\w.!+-]+", line), line


def test_no_build_file_names_a_place_to_fetch_from() -> None:
    for name in (*LOCKS, "pyproject.toml", "Makefile", ".ci/run"):
        text = (ROOT / name).read_text()
        assert not re.search(r"\w+://|index-url|find-links|--trusted-host", text), name


def test_every_extra_is_pinned_somewhere() -> None:
    assert set().union(*LOCKS.values()) == EXTRAS


@pytest.mark.parametrize("lock", LOCKS)
def test_every_declared_dependency_is_pinned_to_a_version_that_it_admits(lock: str) -> None:
    versions = pins(lock)
    builders = {canonicalize_name(r.name): r for r in map(Requirement, SETTINGS["build-system"]["requires"])}
    for name, requirement in (builders | declared(*LOCKS[lock])).items():
        assert name in versions, f"{name} is not in {lock}: run `make lock`"
        assert versions[name] in requirement.specifier, f"{requirement} against {versions[name]}"


def test_everything_that_they_need_in_turn_is_pinned() -> None:
    missing = closure(list(declared("dev"))) - set(pins())
    assert missing == set(), "run `make lock`"


@pytest.mark.parametrize("folder", sorted(OURS))
def test_the_sources_import_only_what_is_declared(folder: str) -> None:
    # distributed runs a study on a cluster, xarray is one of many forms; whoever asks for one installs the extra
    allowed = set(declared("cluster", "exchange"))
    check_imports(folder, allowed)


def test_the_tests_import_only_what_the_test_set_up_installs() -> None:
    # packaging comes with pytest
    check_imports("tests", set(declared("dev", "cluster")) | {"packaging"})


def check_imports(folder: str, allowed: set[str]) -> None:
    providers = packages_distributions()
    for module, path in imported(folder).items():
        names = {canonicalize_name(n) for n in providers.get(module, [IMPORT_NAMES.get(module, module)])}
        assert names & allowed, f"{path} imports {module}, which pyproject.toml does not declare"
