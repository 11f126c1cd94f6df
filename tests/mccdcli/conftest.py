"""Running `mccd` as its users do: as a process of its own."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from tests import running

Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(autouse=True)
def log_folder(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Keep the files that bugs leave behind out of the home of whoever runs the tests; return where they go."""
    folder = tmp_path_factory.mktemp("home")
    monkeypatch.setenv("XDG_STATE_HOME", str(folder))
    monkeypatch.setenv("HOME", str(folder))
    return folder


@pytest.fixture
def mccd() -> Run:
    """Return a function that runs `mccd ARGUMENTS` to its end and returns the process with its output."""

    return lambda *arguments, **environment: running.mccd(*arguments, env=environment)
