"""What a command gave, as digests: what `soak_hostile` compares between sound and damaged files."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

import h5py


def results(said: str, folder: Path, before: set[Path]) -> dict[str, str]:
    """Return digests of the words, without progress and remarks, and of every file that was not there before.

    Of a log, those are the digests of its numbers: its attributes hold the time of the run.
    """
    words = "\n".join(line for line in said.splitlines() if not line.startswith("mccd: "))
    found = {"words": _digest(words.encode())}
    for path in sorted(set(folder.rglob("*")) - before):
        if path.is_file() and not path.is_symlink():
            name = str(path.relative_to(folder))
            found |= {name: _digest(path.read_bytes())} if path.suffix != ".h5" else dict(_numbers(path, name))
    return found


def _numbers(path: Path, name: str) -> Iterator[tuple[str, str]]:
    """Yield a name and a digest of every array of a log."""
    with h5py.File(path) as log:
        arrays: list[h5py.Dataset] = []
        log.visititems(lambda _, item: arrays.append(item) if isinstance(item, h5py.Dataset) else None)
        for array in arrays:
            yield f"{name}{array.name}", _digest(array[()].tobytes() if array.dtype.kind in "iufc" else b"")


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
