"""Small files that stand beside data or settings: read within a limit of size, and only where they are ordinary files.

A pipe would keep its reader waiting, a device never ends, and a link may lead to either. So a file is opened without
waiting, looked at, and read up to its limit and no further, whatever its folder says of its size.
"""

from __future__ import annotations

import errno
import os
import stat

SIDECAR_BYTES = 4096
"""A checksum of one line, a seal."""

TOML_BYTES = 10_000_000
"""What a person writes: models, controllers, campaigns, studies, settings, maps of an import."""

STATE_BYTES = 64 * 2**20
"""What a program keeps in JSON: the state of a campaign or an investigation, outcomes, results."""

TABLE_BYTES = 1_000_000_000
"""Numbers in text or in a sealed file that are held in memory as a whole: waveforms, responses, truths."""

_OPEN = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOCTTY", 0)
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def open_regular(path: str | os.PathLike[str]) -> int:
    """Open an ordinary file without waiting and return its descriptor; raises OSError for anything else."""
    descriptor = os.open(path, _OPEN)
    try:
        kind = stat.S_IFMT(os.fstat(descriptor).st_mode)
        if kind != stat.S_IFREG:
            raise OSError(errno.EINVAL, f"it is {_KINDS.get(kind, 'no ordinary file')}, no ordinary file", str(path))
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def read_small(path: str | os.PathLike[str], most_bytes: int) -> bytes:
    """Return what an ordinary file of at most `most_bytes` holds; raises OSError, which says what else it is."""
    with open(open_regular(path), "rb") as file:
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise OSError(errno.EFBIG, f"it holds more than {most_bytes} bytes", str(path))
    return content


def read_small_text(path: str | os.PathLike[str], most_bytes: int, encoding: str = "utf-8") -> str:
    """Return the text of a file as `read_small`, line feeds as Python's; raises UnicodeDecodeError for other text."""
    text = read_small(path, most_bytes).decode(encoding)
    return text.replace("\r\n", "\n").replace("\r", "\n")
