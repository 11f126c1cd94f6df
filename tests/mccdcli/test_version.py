"""`mccd --version` says which release and which commit."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

import mccdcli.version
from mccdcli.version import source_commit, version_line

ROOT = Path(__file__).parents[2]


def test_version_and_commit(mccd) -> None:
    done = mccd("--version")
    assert done.returncode == 0
    assert done.stderr == ""
    assert re.fullmatch(r"mccd \d+\.\d+\.\d+\S*( \(commit [0-9a-f]{7,}(-dirty)?\))?\n", done.stdout)


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="these sources are not a git checkout")
def test_the_commit_is_that_of_the_checkout() -> None:
    head = subprocess.run(
        ["git", "-C", str(ROOT), "rev-parse", "HEAD"], capture_output=True, text=True, check=True
    ).stdout
    commit = source_commit()
    assert commit is not None
    assert head.startswith(commit.removesuffix("-dirty"))


def test_outside_a_checkout_the_commit_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mccdcli.version, "__file__", str(tmp_path / "mccdcli" / "version.py"))
    assert source_commit() is None
    assert "commit" not in version_line()
