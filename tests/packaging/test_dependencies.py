"""What is imported is declared, what is declared is pinned, and the pins name no place to fetch from."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution, packages_distributions
from pathlib import Path

import pytest
from packaging.markers import Marker
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = SETTINGS["project"]
OURS = {"sim_backend", "campaigns", "analysis", "mccd", "mccdcli"}
EXTRAS = set(PROJECT["optional-dependencies"])
# one of them asks for an older numpy than all the others, and is pinned beside what it is tested with
LOCKS = {
    "constraints.txt": EXTRAS - {"peers-diagnosis"},
    "requirements.txt": {"dev", "docs", "cluster"},
    "requirements-run.txt": set(),
    "constraints-peers-diagnosis.txt": {"dev", "peers-diagnosis"},
}
PIN = re.compile(
    r"(?P<name>[A-Za-z0-9][\w.-]*)==(?P<version>[\w.!+-]+)(?: ; (?P<marker>[^\\]+?))?((?: --hash=sha256:[0-9a-f]{64})+)"
)
# names that a distribution gives to its import, for those that need not be installed here
IMPORT_NAMES = {"myst_parser": "myst-parser", "distributed": "distributed", "dask": "distributed"}


def pins(lock: str = "constraints.txt") -> dict[str, str]:
    """Return the version of each distribution that a file pins for this Python and system."""
    found = [PIN.fullmatch(line) for line in entries(lock)]
    here = [m for m in found if m and (m["marker"] is None or Marker(m["marker"]).evaluate({"extra": ""}))]
    return {canonicalize_name(m["name"]): m["version"] for m in here}


def entries(lock: str) -> list[str]:
    """Return the pins of a file, each with its digests, in one line."""
    text = (ROOT / lock).read_text().replace(" \\\n    ", " ")
    return [line for line in text.splitlines() if not line.startswith("#")]


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
def test_every_line_is_one_exact_pin_with_digests_and_names_no_host(lock: str) -> None:
    assert len(entries(lock)) > 20
    for line in entries(lock):
        assert PIN.fullmatch(line), line


def test_what_is_set_up_is_pinned_as_with_all_extras_and_by_the_same_digests() -> None:
    files = {(m["name"], m["version"]): m[4] for m in map(PIN.fullmatch, entries("constraints.txt")) if m}
    for lock in ("requirements.txt", "requirements-run.txt"):
        assert {
            (m["name"], m["version"]): m[4] for m in map(PIN.fullmatch, entries(lock)) if m
        }.items() <= files.items()


@pytest.mark.parametrize(
    ("changed", "stale"),
    [
        ('"click>=8.5",\n', set(LOCKS)),
        ('"furo>=2024.5", ', {"constraints.txt", "requirements.txt"}),
        ('"sysidentpy>=0.9"', {"constraints-peers-diagnosis.txt"}),
        ('requires = ["setuptools>=77"', set(LOCKS)),
        ("line-length = 120", set()),
    ],
)
def test_pins_for_other_dependencies_are_told_without_the_network(
    tmp_path: Path, changed: str, stale: set[str]
) -> None:
    (tmp_path / "release").mkdir()
    for name in (*LOCKS, "release/lock.py"):
        shutil.copy(ROOT / name, tmp_path / name)
    whole = (ROOT / "pyproject.toml").read_text()
    assert whole.count(changed) == 1

    def check(text: str) -> tuple[int, set[str]]:
        (tmp_path / "pyproject.toml").write_text(text)
        command = [sys.executable, "release/lock.py", "--check"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert all("run `make lock`" in line for line in done.stderr.splitlines())
        return done.returncode, {line.split()[0] for line in done.stderr.splitlines()}

    assert check(whole) == (0, set())
    assert check(whole.replace(changed, re.sub(r"\d+", "1", changed))) == (1 if stale else 0, stale)


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
    missing = closure(list(declared("dev"))) - set(pins("requirements.txt"))
    assert missing == set(), "run `make lock`"


@pytest.mark.parametrize("folder", sorted(OURS))
def test_the_sources_import_only_what_is_declared(folder: str) -> None:
    # a study on a cluster, an xarray, a PDF: whoever asks for one installs the extra
    allowed = set(declared("cluster", "exchange", "pdf"))
    check_imports(folder, allowed)


def test_the_tests_import_only_what_the_test_set_up_installs() -> None:
    # packaging comes with pytest
    check_imports("tests", set(declared("dev", "cluster")) | {"packaging"})


@cache
def providers() -> Mapping[str, list[str]]:
    """Return the distributions that give each module: it takes a look at every file that is installed."""
    return packages_distributions()


def check_imports(folder: str, allowed: set[str]) -> None:
    for module, path in imported(folder).items():
        names = {canonicalize_name(n) for n in providers().get(module, [IMPORT_NAMES.get(module, module)])}
        assert names & allowed, f"{path} imports {module}, which pyproject.toml does not declare"
