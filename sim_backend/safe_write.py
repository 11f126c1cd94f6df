"""Files written whole or not at all, where they were named and nowhere else.

Whoever may write into a folder can put links there. So content goes into a new file of a random name, which no link can
stand for, and that file is renamed: a rename replaces a link and never follows it. A failure leaves what was there.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, TextIO

from sim_backend.errors import ConfigError
from sim_backend.small_files import open_regular

NAME_SHOWN = 40
"""Characters of the final name that the hidden one begins with: it stays shorter than the 255 bytes of a name."""

OWN_BYTES = 1024
"""Of a file that may be replaced: by so many it is known as one of ours."""

READABLE = 0o666
"""Permissions of a new file before the user's umask takes some away."""

_OF_THE_DISK = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS})
_NEW = os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC


def write_text(path: Path, text: str) -> Path:
    """Write UTF-8 text to `path`, replacing a file or link there; return the path. Raises as `whole_file`."""
    return write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, data: bytes, mode: int = READABLE) -> Path:
    """Write `data` to `path`, replacing a file or link there; return the path. Raises as `whole_file`."""
    with whole_file(path, mode=mode) as stream:
        stream.write(data)
    return path


@contextlib.contextmanager
def whole_file(path: Path, *, replace: bool = True, mode: int = READABLE) -> Iterator[BinaryIO]:
    """Give a new file that may be written at any place; leaving the block brings it to the disk and names it `path`.

    An exception removes it. Raises ConfigError for a path that is not an ordinary file or, unless it may `replace`, is
    taken; OSError that names `path` when the disk does not take it.
    """
    require_ordinary(path)
    hidden = hidden_name(path)
    with _named(path, hidden):
        descriptor = os.open(hidden, os.O_RDWR | _NEW, mode)
        with _removed_on_failure(hidden):
            with os.fdopen(descriptor, "w+b") as stream:
                yield stream
                stream.flush()
                os.fsync(stream.fileno())
            give_name(hidden, path, replace=replace)


@contextlib.contextmanager
def whole_text_file(path: Path, *, replace: bool = True) -> Iterator[TextIO]:
    """Give a new text file (UTF-8, line ends as written); otherwise as `whole_file`."""
    with whole_file(path, replace=replace) as stream:
        text = io.TextIOWrapper(stream, encoding="utf-8", newline="")
        try:
            yield text
            text.flush()
        finally:
            with contextlib.suppress(OSError):  # it flushes, and the first error is the one to report
                text.detach()


@contextlib.contextmanager
def whole_path(path: Path, *, replace: bool = True) -> Iterator[Path]:
    """Give a random name beside `path` to a library that makes files itself, exclusively; otherwise as `whole_file`."""
    require_ordinary(path)
    hidden = hidden_name(path)
    with _named(path, hidden), _removed_on_failure(hidden):
        yield hidden
        descriptor = os.open(hidden, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
        give_name(hidden, path, replace=replace)


def hidden_name(path: Path) -> Path:
    """Return a name in the folder of `path` that nobody can foresee."""
    return path.with_name(f".{path.name[:NAME_SHOWN]}.{os.urandom(8).hex()}.tmp")


def give_name(hidden: Path, path: Path, *, replace: bool) -> None:
    """Rename the finished file `hidden` to `path`; raises ConfigError when that is taken and may not be replaced."""
    if replace:
        os.replace(hidden, path)
        return
    try:
        os.link(hidden, path, follow_symlinks=False)  # unlike a rename, it fails when the name is taken meanwhile
    except FileExistsError:
        raise ConfigError(f"{path} exists and is not overwritten; choose another path") from None
    except OSError:  # a file system without hard links
        os.rename(hidden, path)
        return
    os.unlink(hidden)


def require_ordinary(path: Path) -> None:
    """Raise ConfigError where `path` is something that a file cannot replace: a folder, a device, a pipe.

    So does a name that is not UTF-8 text: checksums and lists of files could not hold it.
    """
    if path.name != path.name.encode("utf-8", "replace").decode("utf-8"):
        raise ConfigError(f"the name {str(path)!r} holds bytes that are no UTF-8 text; choose another")
    try:
        found = os.lstat(path)
        # /dev/stdout is a link into /proc: replacing it would harm every other program
        special = os.readlink(path).startswith("/proc/") if stat.S_ISLNK(found.st_mode) else not _is_file(found)
    except OSError:  # nothing is there; a path without access fails later with its own error
        return
    if special:
        what = "a folder" if stat.S_ISDIR(found.st_mode) else "a device, a pipe or an open stream"
        raise ConfigError(f"{path} is {what} and no file that could be written; name a new file in an ordinary folder")


def require_new_or_own(path: Path, is_own: Callable[[bytes], bool], what: str) -> None:
    """Raise ConfigError unless `path` can be written and holds nothing, or what `is_own` by its first bytes.

    What would be written in the end is reported now, before any work: `what` names it. Raises OSError that names `path`
    where its folder takes no file.
    """
    require_ordinary(path)
    if path.exists():
        try:
            with open(open_regular(path), "rb") as file:
                begin = file.read(OWN_BYTES)
        except OSError:  # whoever may not read it does not know what it is
            begin = b"?"
        if begin and not is_own(begin):
            raise ConfigError(f"{path} exists and is not a {what}; give another name")
    hidden = hidden_name(path)
    with _named(path, hidden):
        os.close(os.open(hidden, os.O_WRONLY | _NEW, READABLE))
        os.unlink(hidden)


def require_no_link(path: Path) -> None:
    """Raise ConfigError where `path`, which a library is to open for writing, is a link."""
    if path.is_symlink():
        raise ConfigError(
            f"{path} is a link, and what is written there could go anywhere; remove it, or choose another"
        )


def folder_within(parent: Path, name: str) -> Path:
    """Return the folder `name` in `parent`, made if need be; raises ConfigError for a link, which may lead anywhere."""
    folder = unnamed_folder(parent / name)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def unnamed_folder(folder: Path) -> Path:
    """Return a folder that the user has not named himself, as it is; raises ConfigError for a link in its place.

    Its name comes from a file or from the program, so that whoever packed the files around it may have laid the link.
    """
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise ConfigError(
            f"{folder} is a link or a file, and a folder of results is to stand there; remove it, or choose another"
        )
    return folder


def open_lock(path: Path) -> BinaryIO:
    """Open a file that is only locked, made if need be; it is never emptied. Raises ConfigError for anything else."""
    fix = "remove it, or choose another folder"
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, READABLE)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise ConfigError(f"{path} is a link, and a lock follows none; {fix}") from None
        if error.errno in (errno.EISDIR, errno.ENXIO):
            raise ConfigError(f"{path} is not an ordinary file, as a lock must be; {fix}") from None
        raise
    stream = os.fdopen(descriptor, "r+b", buffering=0)
    if not _is_file(os.fstat(descriptor)):
        stream.close()
        raise ConfigError(f"{path} is not an ordinary file, as a lock must be; {fix}")
    return stream


def _is_file(found: os.stat_result) -> bool:
    return stat.S_ISREG(found.st_mode)


@contextlib.contextmanager
def _removed_on_failure(hidden: Path) -> Iterator[None]:
    try:
        yield
    except BaseException:
        with contextlib.suppress(OSError):  # the first error is the one to report
            os.unlink(hidden)
        raise


@contextlib.contextmanager
def _named(path: Path, hidden: Path) -> Iterator[None]:
    """Let errors of the disk name the file that the user knows."""
    try:
        yield
    except OSError as error:
        if error.filename == os.fspath(hidden) or (error.filename is None and error.errno in _OF_THE_DISK):
            error.filename = os.fspath(path)
        raise
