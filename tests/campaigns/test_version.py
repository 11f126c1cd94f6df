"""The version and the commit that logs and reports are stamped with."""

from __future__ import annotations

import subprocess
import tomllib
from pathlib import Path

import pytest

import campaigns.version
from campaigns.version import tool_commit, tool_version

ROOT = Path(__file__).parents[2]


def test_the_version_is_that_of_the_project() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert tool_version() == project["version"]


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="these sources are not a git checkout")
def test_the_commit_is_that_of_the_checkout() -> None:
    command = ["git", "-C", str(ROOT), "rev-parse", "HEAD"]
    head = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    short = tool_commit().removesuffix("-dirty")
    assert len(short) >= 7
    assert head.startswith(short)


def test_a_changed_checkout_is_told_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def git(*arguments: str) -> None:
        identity = ["-c", "user.name=A", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false"]
        subprocess.run(["git", "-C", str(tmp_path), *identity, *arguments], check=True, capture_output=True)

    git("init")
    (tmp_path / "file").write_text("1")
    git("add", "file")
    git("commit", "-m", "one")
    monkeypatch.setattr(campaigns.version, "__file__", str(tmp_path / "campaigns" / "version.py"))
    clean = tool_commit()
    assert clean.isalnum()
    (tmp_path / "file").write_text("2")
    assert tool_commit() == f"{clean}-dirty"


def test_outside_a_checkout_the_commit_is_unknown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaigns.version, "__file__", str(tmp_path / "campaigns" / "version.py"))
    assert tool_commit() == "unknown"
