"""What an installation holds, and that the commands of the README are there."""

from __future__ import annotations

import os
import re
import subprocess
import tomllib
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath

import pytest

from analysis.challenge.families import slugs
from sim_backend.effects import effect_class
from tests.selection import COLLECTED, STAY, THOROUGH, is_thorough

ROOT = Path(__file__).parents[2]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text())
PACKAGES = ("sim_backend", "campaigns", "analysis", "mccd", "mccdcli")


def test_the_script_and_its_target() -> None:
    assert SETTINGS["project"]["scripts"] == {"mccd": "mccdcli.main:main"}


def test_every_folder_with_sources_is_a_package() -> None:
    # without __init__.py neither the type checker nor the import contracts would look into the folder
    for package in PACKAGES:
        for source in (ROOT / package).rglob("*.py"):
            assert (source.parent / "__init__.py").exists(), f"{source.parent} lacks __init__.py"


def test_every_file_that_is_not_a_source_is_package_data() -> None:
    patterns = SETTINGS["tool"]["setuptools"]["package-data"]["*"]
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*"):
            if not path.is_file() or path.suffix == ".py" or "__pycache__" in path.parts:
                continue
            inside = PurePosixPath(path.relative_to(ROOT / package).as_posix())
            # "**/" stands for any number of folders, none included: match from the right
            assert any(inside.match(pattern.removeprefix("**/")) for pattern in patterns), path


def targets() -> set[str]:
    return set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))


def test_the_readme_s_two_commands_are_targets_of_the_makefile() -> None:
    shell = re.findall(r"```sh\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    own, trial = ([line.partition("#")[0].strip() for line in block.splitlines()] for block in shell[:2])
    assert own == ["mccd import map.toml -o run.h5", "mccd diagnose run.h5 --model nominal.toml"]
    assert trial == ["make report", "make test"]
    assert {"report", "test", "test-all", "check"} <= targets()


def test_continuous_integration_runs_the_readme_s_command() -> None:
    script = ROOT / ".ci" / "run"
    assert os.access(script, os.X_OK)
    lines = script.read_text().splitlines()
    assert lines[0] == "#!/usr/bin/env bash"
    assert "set -euo pipefail" in lines
    assert any(line.startswith("make test ") for line in lines)
    checks = re.search(r"^check: (.+)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert checks is not None
    assert f"for step in {checks[1]}; do" in lines


@pytest.mark.parametrize(("failing", "last"), [("", "= 2 passed ="), ("check-lint", "failed: make check-lint")])
def test_a_step_that_fails_names_itself_in_the_last_line(failing: str, last: str, tmp_path: Path) -> None:
    """With a make that only says what it was asked for, and fails where it is told to."""
    (tmp_path / ".ci").mkdir()
    script = tmp_path / ".ci" / "run"
    script.write_text((ROOT / ".ci" / "run").read_text())
    make = tmp_path / "make"
    make.write_text(f'#!/bin/sh\n[ "$1" = test ] && echo "= 2 passed ="\n[ "$1" != "{failing}" ]\n')
    make.chmod(0o755)
    done = subprocess.run(
        ["bash", str(script)],
        env=os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == bool(failing), done.stderr
    assert done.stdout.splitlines()[-1] == last


def test_one_marker_in_one_file_decides_what_is_left_to_the_longer_run() -> None:
    options = SETTINGS["tool"]["pytest"]["ini_options"]
    assert options["addopts"][-2:] == ["-m", "not soak and not thorough"]
    makefile = (ROOT / "Makefile").read_text()
    assert re.search(r'^test-all: .*\n\t\$\(TESTS\) -m "not soak" ', makefile, re.MULTILINE)
    marked = [
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "tests").rglob("*.py")
        if re.search(r"mark\.thorough", path.read_text(encoding="utf-8")) and path != Path(__file__)
    ]
    assert marked == ["tests/conftest.py"]


@pytest.mark.parametrize("target", ["report", "test", "check"])
def test_a_dry_run_of_each_target_sets_up_before_it_runs(target: str, tmp_path: Path) -> None:
    fresh = f"VENV={tmp_path / 'fresh'}"
    done = subprocess.run(
        ["make", "--dry-run", fresh, target], cwd=ROOT, capture_output=True, text=True, timeout=60, check=True
    )
    steps = [
        "-m venv",
        "pip install",
        {"report": "mccd report", "test": "-m pytest", "check": "lint-imports"}[target],
    ]
    places = [done.stdout.index(step) for step in steps]
    assert places == sorted(places)


def test_a_python_too_old_is_told_apart_from_a_broken_set_up(tmp_path: Path) -> None:
    old = tmp_path / "python3.9"
    old.write_text("#!/bin/sh\nexit 1\n")  # what the version check of an old Python answers
    old.chmod(0o755)
    done = subprocess.run(
        ["make", f"VENV={tmp_path / 'fresh'}", f"PYTHON={old}", "test"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode != 0
    assert f"mccd needs Python 3.11 or newer; {old} is older or absent" in done.stderr


def test_every_pattern_of_the_longer_run_finds_a_test_and_a_blind_family_of_each_site_stays(
    request: pytest.FixtureRequest,
) -> None:
    collected = request.config.stash[COLLECTED]
    folders = {nodeid.split("/")[1] for nodeid in collected if nodeid.count("/") > 1}
    if len(folders) < len(list((ROOT / "tests").glob("*/"))) - 2:
        pytest.skip("only a part of the tests was collected")
    # as many as there were when the longer run was made, on 2026-11-25, and no fewer
    assert len(collected) >= 3965
    for pattern, why in THOROUGH:
        assert why and any(fnmatchcase(nodeid, f"tests/{pattern}") for nodeid in collected), pattern
    hidden = [nodeid for nodeid in collected if "::test_a_hidden_cause_is_named_and_adding_it_pays[" in nodeid]
    assert len(hidden) == len(slugs())
    stay = {nodeid.partition("[")[2].rstrip("]") for nodeid in hidden if not is_thorough(nodeid)}
    assert {effect_class(slug).site for slug in stay} == {effect_class(slug).site for slug in slugs()}
    for pattern in STAY:
        found = [nodeid for nodeid in collected if fnmatchcase(nodeid, f"tests/{pattern}")]
        assert any(fnmatchcase(nodeid, f"tests/{left}") for nodeid in found for left, _ in THOROUGH), pattern
