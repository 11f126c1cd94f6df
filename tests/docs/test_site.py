"""The site of the documents builds without a warning, and holds every page and every command."""

from __future__ import annotations

import os
import shutil
import subprocess
from html import escape
from importlib.util import find_spec
from pathlib import Path

import pytest

import mccd
from mccdcli.registry import COMMANDS
from mccdcli.schema import values_of
from tests import running
from tests.reading import DOCS

pytestmark = pytest.mark.skipif(
    not all(map(find_spec, ("furo", "myst_parser", "sphinx"))), reason="the extra `docs` is not installed"
)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("site")
    # pages made from the code are written beside the others: not into the sources here
    shutil.copytree(DOCS, home / "docs")
    (home / "benchmarks").symlink_to(DOCS.parent / "benchmarks")  # pages link to results
    done = subprocess.run(
        [
            *running.PYTHON,
            "-m",
            "sphinx",
            "-q",
            "-W",
            "--keep-going",
            "-b",
            "html",
            str(home / "docs"),
            str(home / "out"),
        ],
        capture_output=True,
        text=True,
        timeout=180,
        env=os.environ | {"PYTHONPATH": str(DOCS.parent)},
    )
    assert done.returncode == 0, done.stderr
    return home / "out"


def test_every_page_is_there_and_reached_from_the_first(site: Path) -> None:
    first = (site / "index.html").read_text(encoding="utf-8")
    for page in DOCS.rglob("*.md"):
        name = page.relative_to(DOCS).with_suffix(".html").as_posix()
        assert (site / name).exists(), name
        if not name.startswith(("decisions/0", "index")):
            assert f'href="{name}"' in first, name


def test_the_reference_is_made_from_the_code(site: Path) -> None:
    commands = (site / "reference" / "commands.html").read_text(encoding="utf-8")
    assert all(f"mccd {name}<" in commands for name in COMMANDS)
    assert "held-out segments" in (site / "reference" / "json.html").read_text(encoding="utf-8")
    diagnosis = (site / "reference" / "diagnosis-json.html").read_text(encoding="utf-8")
    assert all(f">{escape(place)}<" in diagnosis for place, _, _ in values_of("diagnose"))
    assert "1440" in (site / "contradictions.html").read_text(encoding="utf-8")
    python = (site / "reference" / "python.html").read_text(encoding="utf-8")
    assert all(f'id="mccd.{name}"' in python for name in mccd.__all__ if name != "MccdError")


def test_it_asks_for_nothing_from_elsewhere(site: Path) -> None:
    # it is read where there is no network, too
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        for start in ('<script src="http', '<link rel="stylesheet" href="http', '<img src="http', "@import url(http"):
            assert start not in text, page
