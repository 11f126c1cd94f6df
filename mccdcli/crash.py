"""The file that a bug leaves behind for its report."""

from __future__ import annotations

import os
import platform
import sys
import tempfile
import traceback
from datetime import UTC, datetime
from pathlib import Path

from platformdirs import user_log_path

from campaigns.version import tool_commit, tool_version


def write_crash_file(error: BaseException) -> Path:
    """Write what a report of `error` needs into the log folder, else a temporary one; return the path."""
    now = datetime.now(UTC)
    text = "\n".join(
        [
            f"{now.isoformat(timespec='seconds')}  mccd {tool_version()} (commit {tool_commit()})",
            f"Python {platform.python_version()} on {platform.platform()}",
            f"command line: {sys.argv}",
            "",
            "".join(traceback.format_exception(error)),
        ]
    )
    name = f"crash-{now:%Y%m%dT%H%M%S}-{os.getpid()}.txt"
    try:
        folder = user_log_path("mccd", appauthor=False)
        if not folder.is_absolute():  # of a user without a home
            raise FileNotFoundError(folder)
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / name
        path.write_text(text, encoding="utf-8", errors="backslashreplace")
    except (OSError, RuntimeError):
        path = Path(tempfile.mkdtemp(prefix="mccd-")) / name
        path.write_text(text, encoding="utf-8", errors="backslashreplace")
    return path
