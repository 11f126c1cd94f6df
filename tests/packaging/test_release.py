"""A release: its version is that of the tag, and what is in the archives is all that it needs to run."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from datetime import date
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("sim_backend", "campaigns", "analysis", "mccd", "mccdcli")
AROUND = ("pyproject.toml", "README.md", "LICENSE", "CHANGELOG.md")


def run(*command: str, cwd: Path, **environment: str) -> str:
    done = subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, timeout=180, env=os.environ | environment, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The archives of a checkout whose commit has the tag v1.2.3; the tools to build are those installed here."""
    sources = tmp_path_factory.mktemp("release") / "sources"
    sources.mkdir()
    for name in AROUND:
        shutil.copy(ROOT / name, sources)
    for package in PACKAGES:
        shutil.copytree(ROOT / package, sources / package, ignore=shutil.ignore_patterns("__pycache__"))

    def git(*arguments: str) -> None:
        identity = ("-c", "user.name=A", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false")
        run("git", *identity, *arguments, cwd=sources)

    git("init", "-q")
    git("add", ".")
    git("commit", "-q", "-m", "one")
    git("tag", "v1.2.3")
    # the wheel is built from the source archive, so that both are tried
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", "dist", cwd=sources)
    return sources / "dist"


def test_the_newest_release_is_the_same_in_changelog_sources_and_citation() -> None:
    """What is tagged, what sources without their history say, and what a paper cites."""
    heads = re.findall(
        r"^## \[(.+?)\](?: - (\S+))?$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert heads[0] == ("Unreleased", "")
    version, day = heads[1]
    assert date.fromisoformat(day) and re.fullmatch(r"\d+\.\d+\.\d+", version)
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools_scm"]
    assert settings["fallback_version"] == version
    cited = (ROOT / "CITATION.cff").read_text(encoding="utf-8").splitlines()
    assert f"version: {version}" in cited and f"date-released: {day}" in cited


def test_both_archives_have_the_version_of_the_tag(dist: Path) -> None:
    assert {path.name for path in dist.iterdir()} == {"mccd-1.2.3-py3-none-any.whl", "mccd-1.2.3.tar.gz"}


def test_the_wheel_holds_every_file_of_the_packages(dist: Path) -> None:
    held = set(zipfile.ZipFile(dist / "mccd-1.2.3-py3-none-any.whl").namelist())
    files = {
        str(path.relative_to(ROOT))
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert files - held == set()
    assert any(name.endswith("licenses/LICENSE") for name in held)


def test_the_source_archive_holds_the_licence_and_the_readme(dist: Path) -> None:
    names = tarfile.open(dist / "mccd-1.2.3.tar.gz").getnames()
    assert {f"mccd-1.2.3/{name}" for name in AROUND} <= set(names)


def test_an_installed_wheel_runs_on_its_own(dist: Path, tmp_path: Path) -> None:
    place = tmp_path / "site"
    wheel = str(dist / "mccd-1.2.3-py3-none-any.whl")
    run(
        sys.executable,
        "-m",
        "pip",
        "install",
        "-q",
        "--no-deps",
        "--no-index",
        "--target",
        str(place),
        wheel,
        cwd=tmp_path,
    )
    alone = {"PYTHONPATH": str(place), "HOME": str(tmp_path)}
    where = run(sys.executable, "-c", "import mccdcli, sim_backend; print(mccdcli.__file__)", cwd=tmp_path, **alone)
    assert where.startswith(str(place))
    assert run(sys.executable, "-m", "mccdcli", "--version", cwd=tmp_path, **alone) == "mccd 1.2.3 (commit unknown)\n"
    # models, campaigns, templates and schemas are data: each is asked for once
    assert "as-built" in run(sys.executable, "-m", "mccdcli", "bench", "list", cwd=tmp_path, **alone)
    assert "paper" in run(sys.executable, "-m", "mccdcli", "campaign", "list", cwd=tmp_path, **alone)
    assert "checks" in run(sys.executable, "-m", "mccdcli", "schema", "chop", cwd=tmp_path, **alone)
    page = "from analysis.report.page import render_page; print(len(render_page([], {}, {}, [])))"
    assert int(run(sys.executable, "-c", page, cwd=tmp_path, **alone)) > 1000


def test_the_bill_of_materials_names_every_package_with_its_digests(tmp_path: Path) -> None:
    pytest.importorskip("cyclonedx_py", reason="comes with the extra dev")
    (tmp_path / "mccd-1.2.3-py3-none-any.whl").touch()
    run(sys.executable, str(ROOT / "release" / "bill.py"), str(tmp_path), cwd=tmp_path)
    bill = json.loads((tmp_path / "mccd-1.2.3.cdx.json").read_text())
    assert bill["bomFormat"] == "CycloneDX"
    assert bill["metadata"]["component"]["version"] == "1.2.3"
    pinned = {line.split(" ")[0] for line in (ROOT / "requirements-run.txt").read_text().splitlines() if "==" in line}
    assert {f"{part['name']}=={part['version']}" for part in bill["components"]} == pinned
    for part in bill["components"]:
        assert part["purl"].startswith("pkg:pypi/")
        assert all(digest["alg"] == "SHA-256" for place in part["externalReferences"] for digest in place["hashes"])
