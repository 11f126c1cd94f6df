"""What to do with a log that can no longer be written: say why, and let the file go as it is."""

from __future__ import annotations

import contextlib
import os
import re
import tempfile
from pathlib import Path

import h5py

from sim_backend.errors import DataError

_SYSTEM_MESSAGE = re.compile(r"error message = '([^']*)'")


def cannot(verb: str, path: Path, error: Exception, more: str = "") -> DataError:
    """Return the error for a log that could not be made, written or completed, with the system's own reason."""
    fix = "check the folder, its rights and the free space"
    return DataError(f"cannot {verb} the log {path}: {reason_of(error)}{more}; {fix}")


def reason_of(error: Exception) -> str:
    """Return the system's own reason for a failure of HDF5."""
    found = _SYSTEM_MESSAGE.search(str(error))
    if found:
        return found[1]
    if isinstance(error, OSError) and error.errno:
        return os.strerror(error.errno)
    return (str(error).splitlines() or [type(error).__name__])[0]


def let_go(file: h5py.File) -> None:
    """Close a file that refuses to be written and leave on disk what was committed.

    HDF5 insists on writing its remaining state at close; when that fails, it leaves freed objects behind that
    crash the process later. So its file descriptor is pointed at memory first: the remaining state goes there.
    """
    with contextlib.suppress(OSError, RuntimeError, ValueError):
        handle = file.id.get_vfd_handle()
        if hasattr(os, "memfd_create"):
            sink = os.memfd_create("mccd-log")
            os.dup2(sink, handle)
            os.close(sink)
        else:
            with tempfile.TemporaryFile() as stream:
                os.dup2(stream.fileno(), handle)
    with contextlib.suppress(OSError, RuntimeError, ValueError):
        file.close()
