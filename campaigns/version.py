"""Which mccd this is: what every log, figure and report is stamped with."""

from __future__ import annotations

import subprocess
from pathlib import Path


def tool_version() -> str:
    """Return the version of the installed mccd, or `unknown` if it is not installed."""
    from importlib.metadata import PackageNotFoundError, version  # 20 ms, and asked only when something is kept

    try:
        return version("mccd")
    except PackageNotFoundError:
        return "unknown"


def tool_commit() -> str:
    """Return the short commit of the checkout that this file is in, `-dirty` if changed, else `unknown`."""
    root = Path(__file__).resolve().parent.parent
    if not (root / ".git").exists():  # a folder above it may be a checkout of something else
        return "unknown"
    command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--exclude=*"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=5, check=True)
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return done.stdout.strip()
