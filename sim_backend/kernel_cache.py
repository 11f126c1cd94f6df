"""Compiled code kept on disk: every entry carries a digest that is checked before the code is used.

An entry is made once on a machine and read by all later processes. Its name says all that the code depends on, so an
entry is never out of date; an entry that cannot be trusted is treated as absent and the code is made again.
"""

from __future__ import annotations

import os
import re
import stat
import time
import warnings
from functools import cache
from hashlib import sha256
from pathlib import Path

from sim_backend.errors import ConfigError, MccdWarning
from sim_backend.safe_write import write_bytes

VARIABLE = "MCCD_KERNEL_CACHE"
"""Environment variable that names the folder; by default it is one in the user's cache."""

MOST_BYTES = 64 * 2**20
"""Size that no entry comes near; a larger file is not read."""

KEPT_DAYS = 90
"""Entries written longer ago are removed, so that code of old versions does not pile up."""

_OURS = re.compile(r"\.?\w[\w-]*-[0-9a-f]{32}(\.|$)")
"""Names of entries (`sim_backend.jit.entry_name`), and of what a writer that was killed leaves of one."""

_DIGEST_BYTES = sha256().digest_size
_OTHERS_MAY_WRITE = stat.S_IWGRP | stat.S_IWOTH


class KernelCacheWarning(MccdWarning):
    """Compiled code cannot be kept or was damaged; results are the same, but it takes longer to get them."""


def read_entry(name: str) -> bytes | None:
    """Return the entry of that name, or None if there is none that can be trusted."""
    place = _folder()
    if place is None:
        return None
    path = place / name
    try:
        whole = _read(path)
    except FileNotFoundError:
        return None
    except OSError as error:
        _doubt(f"{path} cannot be read ({error.strerror or error})")
        return None
    digest, data = whole[:_DIGEST_BYTES], whole[_DIGEST_BYTES:]
    if digest != _digest(name, data):
        _doubt(f"{path} is damaged")
        return None
    return data


def keep_entry(name: str, data: bytes) -> None:
    """Keep an entry, in one step for other processes; where that cannot be, say so once and go on without."""
    place = _folder()
    if place is None:
        return
    try:
        write_bytes(place / name, _digest(name, data) + data, mode=0o600)
    except ConfigError as error:  # something else has the entry's name
        _doubt(str(error))
    except OSError as error:
        _doubt(f"{place} cannot be written ({error.strerror or error})")


def _digest(name: str, data: bytes) -> bytes:
    # with the name: an entry copied over another one is damage, too
    return sha256(name.encode() + b"\0" + data).digest()


def _read(path: Path) -> bytes:
    """Return what an ordinary file of ours holds; raises OSError for anything else."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    with open(descriptor, "rb") as file:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode) or found.st_size > MOST_BYTES:
            raise OSError(f"it is not a file of at most {MOST_BYTES} bytes")
        if not _only_ours(found):
            raise OSError("another user may write it")
        return file.read(MOST_BYTES)


def _only_ours(found: os.stat_result) -> bool:
    """Tell whether nobody but this user and root can have written there."""
    return found.st_uid in (os.geteuid(), 0) and not found.st_mode & _OTHERS_MAY_WRITE


def _others_may_exchange(found: os.stat_result) -> bool:
    """Tell whether other users may replace the content of a folder."""
    return bool(found.st_mode & _OTHERS_MAY_WRITE) and not found.st_mode & stat.S_ISVTX


def _folder() -> Path | None:
    """Return the folder to use, or None where there is none that can be trusted."""
    return _checked(os.environ.get(VARIABLE, ""))


@cache
def _checked(chosen: str) -> Path | None:
    """Return the chosen folder, or for "" the user's own, made if it is not there; warn and return None if unusable."""
    try:
        place = Path(chosen) if chosen else _of_the_user()
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        place = place.resolve(strict=True)
        found, above = place.stat(), [folder for folder in place.parents if _others_may_exchange(folder.stat())]
    except (OSError, RuntimeError, ValueError) as error:  # the user has no home, or the name cannot be one
        _doubt(f"there is no folder to keep compiled code in ({error})")
        return None
    if above or not _only_ours(found):
        _doubt(f"{above[0] if above else place} may be written by other users")
        return None
    _remove_old(place)
    return place


def _of_the_user() -> Path:
    from platformdirs import user_cache_path  # needed only where nothing else is chosen

    place = user_cache_path("mccd", appauthor=False) / "kernels"
    if not place.is_absolute():  # "~", where neither the environment nor the system knows a home
        raise RuntimeError("there is no home")
    return place


def _remove_old(place: Path) -> None:
    """Remove old entries, recognised by their names among what else a chosen folder may hold."""
    limit = time.time() - KEPT_DAYS * 86_400
    try:
        ours = [entry for entry in os.scandir(place) if _OURS.match(entry.name)]
        old = [entry.path for entry in ours if entry.stat(follow_symlinks=False).st_mtime < limit]
        for path in old:
            os.unlink(path)
    except OSError:
        return  # another process removes them, or the folder is read-only: nothing depends on it


_told: set[str] = set()
"""Whether this process has warned already: it says so once."""


def _doubt(why: str) -> None:
    if not _told:
        _told.add(why)
        warnings.warn(
            f"kernel cache: {why}; the code is compiled again, which only takes longer. "
            f"Remove it, or set {VARIABLE} to a folder of your own",
            KernelCacheWarning,
            stacklevel=2,
        )
