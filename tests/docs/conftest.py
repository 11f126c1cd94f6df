"""Somebody who follows a page."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from pathlib import Path

import pytest

from tests import running
from tests.reading import DOCS


@pytest.fixture
def reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of somebody who follows a page: the examples are there, `mccd` is found, nothing else is."""
    shutil.copytree(DOCS / "examples", tmp_path / "docs" / "examples")
    tool = tmp_path / "bin" / "mccd"
    tool.parent.mkdir()
    tool.write_text(f'#!/bin/sh\nexec {shlex.join(running.MCCD)} "$@"\n')
    tool.chmod(0o755)
    python = tool.with_name("python")
    python.symlink_to(sys.executable)
    monkeypatch.setenv("PATH", f"{tool.parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(DOCS.parent))
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    return tmp_path
