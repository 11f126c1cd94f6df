"""Space on the disk, allocated before it is needed: a log that is refused it has not been touched and stays sound.

HDF5 writes its tables in place. When the disk is full in the middle of that, some tables refer to what others do not
know yet, and the file can no longer be opened. So the blocks behind its end are allocated first.
"""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

import h5py

from sim_backend.errors import DataError

INDEX_BYTES = 2096
"""A node of the tree in which HDF5 looks up chunks; it holds 32 to 64 of them once its neighbours are full."""

CHUNKS_PER_NODE = 32
NODES_SPARE = 4
"""A tree of 32⁴ chunks of 4096 samples, 119 hours at 10 kHz, splits so many nodes at once."""

CHECKSUM_BYTES = 4
CLOSING_BYTES = 2**16
"""Status and times at the end: a heap for texts (4 KiB), a longer object header, and as much again."""

CHANNEL_BYTES = 2**13
"""Object header, name and attributes, whose texts lie in heaps of 4 KiB."""

UTF_8_BYTES = 4

_UNKNOWN = {errno.EINVAL, errno.EOPNOTSUPP, errno.ENOSYS, errno.ENOTSUP}


def header_bytes(texts: int, channels: int) -> int:
    """Return what a log takes before its first sample: `texts` characters in the header, and so many channels."""
    return CLOSING_BYTES + 2 * UTF_8_BYTES * texts + channels * CHANNEL_BYTES


def rows_bytes(rows: int, chunk_rows: int, channels: int) -> int:
    """Return what `rows` take in whole chunks of all channels, with one chunk more for an unfinished one."""
    chunks = -(-rows // chunk_rows) + 1
    data = chunks * (8 * chunk_rows + CHECKSUM_BYTES)
    return channels * (data + INDEX_BYTES * (chunks // CHUNKS_PER_NODE + NODES_SPARE))


def require_free(folder: Path, size_bytes: float) -> None:
    """Raise DataError when the disk of `folder` has less than `size_bytes` free: asked before a test, not in it."""
    if not folder.is_dir():
        return
    free = shutil.disk_usage(folder).free
    if free < size_bytes:
        raise DataError(
            f"the disk of {folder} has {free / 1e6:.3g} MB free and the logs take {size_bytes / 1e6:.3g} MB: "
            "free some, or choose another folder"
        )


def take(file: h5py.File, size_bytes: int) -> None:
    """Let the file system keep `size_bytes` behind the end of what HDF5 uses of `file`, until `give_back`.

    Raises OSError when it cannot. Where a file system does not know how, nothing happens.
    """
    if not hasattr(os, "posix_fallocate"):
        return
    try:
        os.posix_fallocate(file.id.get_vfd_handle(), file.id.get_filesize(), size_bytes)
    except OSError as error:
        if error.errno not in _UNKNOWN:
            raise


def give_back(path: Path, size_bytes: int) -> None:
    """Cut the closed file at `path` down to what HDF5 itself uses of it; raises OSError."""
    if path.stat().st_size > size_bytes:
        descriptor = os.open(path, os.O_WRONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
        try:
            os.ftruncate(descriptor, size_bytes)
        finally:
            os.close(descriptor)
