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
from sim_backend.safe_write import write_text


def write_crash_file(error: BaseException) -> Path | None:
    """Write what a report of `error` needs into the log folder, else a temporary one; return the path, None if none."""
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
    for folder in (_log_folder, _temporary_folder):
        try:
            return write_text(folder() / name, text.encode("utf-8", "backslashreplace").decode("utf-8"))
        except (OSError, RuntimeError):  # RuntimeError: the user has no home
            continue
    return None


def _log_folder() -> Path:
    folder = user_log_path("mccd", appauthor=False)
    if not folder.is_absolute():
        raise RuntimeError("there is no home")  # some versions say so by a path that begins with ~
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _temporary_folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="mccd-"))
