"""The version and the commit that logs and reports are stamped with."""

from __future__ import annotations

import subprocess
from importlib.metadata import version
from pathlib import Path

import pytest
from packaging.version import Version

import campaigns.version
from campaigns.version import tool_commit, tool_version

ROOT = Path(__file__).parents[2]


def test_the_version_is_that_of_the_installation() -> None:
    # which version a build gets stands in tests/packaging/test_release.py
    assert tool_version() == version("mccd")
    assert Version(tool_version()) > Version("0")


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
