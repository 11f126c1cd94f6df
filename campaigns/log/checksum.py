"""The checksum sidecar: `RUN.h5.sha256` beside `RUN.h5`, in the format that `sha256sum -c` checks."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from campaigns.progress import Report, unheard
from sim_backend.errors import DataError
from sim_backend.safe_write import write_text
from sim_backend.small_files import SIDECAR_BYTES, open_regular, read_small_text

_BLOCK_BYTES = 2**20


def sidecar_of(path: Path) -> Path:
    """Return the path of the checksum that belongs to the log at `path`."""
    return path.with_name(path.name + ".sha256")


def sha256_of(path: Path, report: Report = unheard) -> str:
    """Return the SHA-256 of the file at `path` as hexadecimal text; raises DataError if it cannot be read."""
    digest, done = hashlib.sha256(), 0
    try:
        with open(open_regular(path), "rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            while block := stream.read(_BLOCK_BYTES):
                digest.update(block)
                done += len(block)
                report(done, max(size, done), f"checksum of {path.name}")
        return digest.hexdigest()
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror}; check the path and its rights") from None


def write_sidecar(path: Path) -> str:
    """Bring the closed log at `path` to disk, write its checksum beside it and return the checksum.

    The sidecar appears whole or not at all. Raises OSError when either cannot be written.
    """
    with path.open("rb") as stream:
        os.fsync(stream.fileno())
    digest = sha256_of(path)
    write_text(sidecar_of(path), f"{digest}  {path.name}\n")
    return digest


def read_sidecar(path: Path) -> str | None:
    """Return the checksum that the sidecar of `path` promises, or None without a sidecar.

    Raises DataError when the sidecar is not one line of checksum and the log's name at the time of writing.
    """
    sidecar = sidecar_of(path)
    try:
        digest, name = read_small_text(sidecar, SIDECAR_BYTES).rstrip("\n").split("  ", 1)
        if len(digest) != 64 or not set(digest) <= set("0123456789abcdef") or not name:
            raise ValueError
    except FileNotFoundError:
        return None
    except (ValueError, OSError):
        raise DataError(f"{sidecar} is not a checksum of one line 'SHA-256  NAME': restore it, or delete it") from None
    return digest
