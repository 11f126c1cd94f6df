"""Opening HDF5 files of unknown origin: what refers outside of the file or exhausts the memory is refused.

The checks read descriptions only (link kinds, layouts, sizes), never data, so a refusal costs no memory.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import h5py
import numpy as np

from campaigns.log.limits import (
    CHUNK_CACHE_BYTES,
    CHUNK_CACHES_BYTES,
    CHUNK_SLOTS,
    FREE_BYTES,
    MAX_CHANNELS,
    MAX_CHUNK_BYTES,
    MAX_EXPANSION,
    MAX_TEXT_BYTES,
)
from sim_backend.errors import DataError
from sim_backend.small_files import open_regular

MAX_RANK = 8
KNOWN_FILTERS = {
    h5py.h5z.FILTER_DEFLATE: "deflate",
    h5py.h5z.FILTER_SHUFFLE: "shuffle",
    h5py.h5z.FILTER_FLETCHER32: "fletcher32",
}
_LINK_KINDS = {h5py.h5l.TYPE_SOFT: "soft", h5py.h5l.TYPE_EXTERNAL: "external"}


def refuse(path: Path, item: str, what: str, fix: str) -> DataError:
    """Return the error for an item of a file that is not accepted, on one line of printable text."""
    return DataError(f"{path}: '{one_line(item)[:120]}' {one_line(what)[:300]}; {fix}")


def one_line(text: str) -> str:
    """Return `text` with every sign that does not print (line feeds, escapes, lone surrogates) written out."""
    return "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in text)


def open_h5(path: Path) -> h5py.File:
    """Open the HDF5 file at `path` for reading, without a lock; raises DataError for any other file."""
    try:
        if not path.is_file():
            raise DataError(f"{path} is not a file: check the path")
        if not h5py.is_hdf5(path):
            raise DataError(
                f"{path} is not an HDF5 file (or its first bytes are damaged): convert it with `mccd import`"
            )
        return h5py.File(path, "r", locking=False)
    except (OSError, RuntimeError, ValueError) as error:
        raise DataError(f"cannot open {path}: {first_line(error)}; restore it from a copy") from None


def link_names(group: h5py.Group, path: Path) -> list[str]:
    """Return the names of the links in `group`; raises DataError for too many or one that is not UTF-8."""
    links = group.id.links
    count = group.id.get_num_objs()
    if count > MAX_CHANNELS:
        raise refuse(path, str(group.name), f"holds {count} items of at most {MAX_CHANNELS}", "split the file")
    raw: list[bytes] = []
    links.iterate(raw.append)
    names = []
    for name in raw:
        try:
            names.append(name.decode("utf-8"))
        except UnicodeDecodeError:
            raise refuse(path, repr(name), "is a name that is not UTF-8", "rename it") from None
    return names


def member(group: h5py.Group, name: str, path: Path, among: int = 1) -> h5py.Group | h5py.Dataset:
    """Return the group or dataset that `group` itself holds under `name`; a dataset passed `check_dataset`.

    HDF5 keeps unpacked chunks of every open dataset: of one `among` many it may keep few.

    Raises DataError when it is missing, a link to elsewhere, or a dataset that is refused.
    """
    item = f"{str(group.name).rstrip('/')}/{name}"
    try:
        kind = group.id.links.get_info(name.encode("utf-8")).type
    except (KeyError, RuntimeError):
        raise refuse(path, item, "is missing", "check that the file is what it should be") from None
    if kind != h5py.h5l.TYPE_HARD:
        what = f"is a link of kind {_LINK_KINDS.get(kind, 'unknown')}; only data inside the file are read"
        raise refuse(path, item, what, "copy the data into the file")
    found = group[name]
    if isinstance(found, h5py.Group):
        return found
    if not isinstance(found, h5py.Dataset):
        raise refuse(path, item, "is neither group nor dataset", "remove it")
    check_dataset(found, path, item)
    if among <= CHUNK_CACHES_BYTES // CHUNK_CACHE_BYTES:
        return found
    access = found.id.get_access_plist()
    access.set_chunk_cache(CHUNK_SLOTS, CHUNK_CACHES_BYTES // among, access.get_chunk_cache()[2])
    del found  # settings count for a dataset that nobody has open
    return h5py.Dataset(h5py.h5d.open(group.id, name.encode("utf-8"), access))


def check_dataset(dataset: h5py.Dataset, path: Path, item: str) -> None:
    """Raise DataError if reading it would leave the file, need a foreign filter or exhaust the memory."""
    plist = dataset.id.get_create_plist()
    layout = plist.get_layout()
    if layout == h5py.h5d.VIRTUAL:
        raise refuse(path, item, "is a virtual dataset", "copy its data into the file")
    if plist.get_external_count():
        raise refuse(path, item, "keeps its data in another file", "copy them into the file")
    if dataset.dtype.hasobject:
        raise refuse(path, item, "has a type of variable length", "store numbers or texts of fixed length")
    if dataset.ndim > MAX_RANK:
        raise refuse(path, item, f"has {dataset.ndim} axes of at most {MAX_RANK}", "reshape it")
    for index in range(plist.get_nfilters()):
        code = plist.get_filter(index)[0]
        if code not in KNOWN_FILTERS:
            allowed = ", ".join(KNOWN_FILTERS.values())
            raise refuse(path, item, f"uses filter {code}, known are {allowed}", "repack it without")
    chunk_bytes = _bytes(dataset.chunks or (), dataset.dtype.itemsize)
    if dataset.chunks and chunk_bytes > MAX_CHUNK_BYTES:
        what = f"has chunks of {chunk_bytes} bytes of at most {MAX_CHUNK_BYTES}"
        raise refuse(path, item, what, "repack it with smaller chunks")
    _check_size(dataset, path, item)


def _check_size(dataset: h5py.Dataset, path: Path, item: str) -> None:
    size = _bytes(dataset.shape or (), dataset.dtype.itemsize)
    stored, in_file = dataset.id.get_storage_size(), stored_bytes(path)
    if stored > in_file:
        raise refuse(path, item, f"claims {stored} stored bytes in a file of {in_file}", "restore it from a copy")
    limit = most_bytes(stored)
    if size > limit:
        what = f"has shape {dataset.shape}, {size} bytes, of at most {limit} for {stored} stored bytes"
        raise refuse(path, item, what, "store it whole and with less compression")


def check_total(datasets: Iterable[h5py.Dataset], path: Path) -> None:
    """Raise DataError if all datasets together exceed the limit for their file; several may share stored bytes."""
    size = sum(_bytes(dataset.shape or (), dataset.dtype.itemsize) for dataset in datasets)
    stored = stored_bytes(path)
    if size > most_bytes(stored):
        what = f"has channels of {size} bytes together, of at most {most_bytes(stored)} for a file of {stored}"
        raise refuse(path, "channels", what, "store them with less compression")


def check_chunks(dataset: h5py.Dataset, path: Path) -> None:
    """Raise DataError if a chunk that is not packed has another size than it must have.

    HDF5 believes the size that the index of a dataset tells, and reads on behind a chunk that is too short.
    """
    if dataset.chunks is None or is_packed(dataset):
        return
    plist = dataset.id.get_create_plist()
    codes = [plist.get_filter(index)[0] for index in range(plist.get_nfilters())]
    wanted = _bytes(dataset.chunks, dataset.dtype.itemsize) + 4 * (h5py.h5z.FILTER_FLETCHER32 in codes)
    wrong: list[int] = []

    def seen(chunk: h5py.h5d.StoreInfo) -> None:
        if chunk.size != wanted or chunk.filter_mask:
            wrong.append(chunk.size)

    try:
        dataset.id.chunk_iter(seen)
    except (OSError, RuntimeError, ValueError) as error:
        raise refuse(path, str(dataset.name), f"is damaged ({first_line(error)})", "restore it from a copy") from None
    if wrong:
        what = f"has chunks of another size ({wrong[0]} bytes stored, {wanted} expected)"
        raise refuse(path, str(dataset.name), what, "restore the file from a copy")


def is_packed(dataset: h5py.Dataset) -> bool:
    """Tell whether the values are compressed: how much they unpack to shows only when it is done."""
    plist = dataset.id.get_create_plist()
    return any(plist.get_filter(k)[0] == h5py.h5z.FILTER_DEFLATE for k in range(plist.get_nfilters()))


def most_bytes(stored: int) -> int:
    """Return how many bytes may come out of so many stored ones before they must be a bomb."""
    return max(MAX_EXPANSION * stored, FREE_BYTES)


def stored_bytes(path: Path) -> int:
    """Return how many bytes of the file at `path` are on the disk: a file with holes holds less than it is long."""
    found = path.stat()
    if not hasattr(found, "st_blocks") or found.st_size <= FREE_BYTES or _allocated(found) >= found.st_size:
        return found.st_size
    descriptor = open_regular(path)
    try:
        os.fsync(descriptor)  # some file systems count blocks when they are written
        return min(found.st_size, _allocated(os.fstat(descriptor)))
    finally:
        os.close(descriptor)


def _allocated(found: os.stat_result) -> int:
    return found.st_blocks * 512


def _bytes(shape: tuple[int, ...], itemsize: int) -> int:
    total = itemsize
    for length in shape:
        total *= int(length)
    return total


def text_attribute(owner: h5py.Group | h5py.Dataset, name: str, path: Path, default: str | None = None) -> str:
    """Return the text attribute `name`, else `default`; raises DataError without both or for no text."""
    item = f"{owner.name}@{name}"
    value = _attribute(owner, name, path)
    if value is None and default is not None:
        return default
    if isinstance(value, bytes):
        value = value.decode("utf-8", "surrogateescape")
    if not isinstance(value, str):
        raise refuse(path, item, "is missing" if value is None else "is not text", "see docs/log-format.md")
    try:
        size = len(value.encode("utf-8"))
    except UnicodeEncodeError:
        raise refuse(path, item, "is not UTF-8", "write it as UTF-8") from None
    if size > MAX_TEXT_BYTES:
        raise refuse(path, item, f"has {size} bytes of at most {MAX_TEXT_BYTES}", "shorten it")
    return value


def number_attribute(owner: h5py.Group | h5py.Dataset, name: str, path: Path) -> float | int | None:
    """Return the number in the attribute `name`, None without it; raises DataError when it is not a number."""
    value = _attribute(owner, name, path)
    if value is None:
        return None
    if not isinstance(value, np.integer | np.floating):
        raise refuse(path, f"{owner.name}@{name}", "is not a single number", "see docs/log-format.md")
    return value.item()


def _attribute(owner: h5py.Group | h5py.Dataset, name: str, path: Path) -> object:
    item = f"{owner.name}@{name}"
    try:
        if not h5py.h5a.exists(owner.id, name.encode()):
            return None
        described = h5py.h5a.open(owner.id, name.encode())
        kind, space = described.get_type(), described.get_space()
        scalar = space.get_simple_extent_npoints() == 1
        simple = isinstance(kind, h5py.h5t.TypeStringID | h5py.h5t.TypeIntegerID | h5py.h5t.TypeFloatID)
        if not (scalar and simple):
            raise refuse(path, item, "is not a single text or number", "see docs/log-format.md")
        if (size := kind.get_size()) > MAX_TEXT_BYTES:
            raise refuse(path, item, f"has {size} bytes of at most {MAX_TEXT_BYTES}", "shorten it")
        value = np.empty(space.get_simple_extent_dims(), described.dtype)
        described.read(value)
    except MemoryError:
        raise refuse(path, item, "takes more memory than there is", "shorten it") from None
    except (OSError, RuntimeError, ValueError, TypeError, UnicodeError) as error:
        raise refuse(path, item, f"cannot be read ({first_line(error)})", "restore it from a copy") from None
    found: object = value.flat[0]
    return found


def first_line(error: BaseException) -> str:
    """Return the first line of an error's text, or its kind when it has none."""
    return (str(error).splitlines() or [type(error).__name__])[0][:200]
