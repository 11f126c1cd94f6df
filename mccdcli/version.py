"""Which mccd this is."""

from __future__ import annotations

import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


def version_line() -> str:
    """`mccd VERSION (commit HASH)`; without the bracket when not run from a git checkout."""
    try:
        number = version("mccd")
    except PackageNotFoundError:
        number = "(not installed)"
    commit = source_commit()
    return f"mccd {number} (commit {commit})" if commit else f"mccd {number}"


def source_commit() -> str | None:
    """Short hash of the checkout that this file belongs to, `-dirty` if changed; None outside a checkout."""
    root = Path(__file__).resolve().parent.parent
    if not (root / ".git").exists():
        return None
    command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--exclude=*"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=5, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
