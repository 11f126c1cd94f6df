"""Objects of MATLAB (timetables, tables, datetimes, strings) beside plain data: known by name, never read as numbers.

The content of such an object is in a part of the file whose format MATLAB does not publish; the object itself is six
whole numbers that point there. scipy's listing of variables fails on one, so the elements of a file of version 5 to 7
are walked here, by "MAT-File Format" (The MathWorks, R2023a), chapter 1; an object's has no dimensions, but its name,
the system of its type and its class.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, replace
from pathlib import Path

import h5py

from sim_backend.errors import DataError

_HEADER = 128
_MATRIX, _COMPRESSED, _OPAQUE = 14, 15, 17
_STRUCTURE = 2
_BLOCK = 2**20
_ENOUGH = 4096
"""Bytes of an element that hold its name and class."""

DECODED = "MATLAB_object_decode"
"""Attribute that marks an object, or a function, in a file of version 7.3."""


@dataclass(frozen=True)
class Variable:
    """A variable of a file of version 5 to 7: an object has a class, `object_of`, and no shape."""

    name: str
    shape: tuple[int, ...] = ()
    object_of: str = ""
    begin: int = 0
    """Position of its element in the file, behind the tag."""
    size: int = 0
    packed: bool = False
    is_structure: bool = False


def variables_in(path: Path) -> list[Variable]:
    """Return all variables of a file of version 5 to 7; raises ValueError, zlib.error or struct.error for any other."""
    found = []
    with path.open("rb") as file:
        order = "<" if file.read(_HEADER)[126:128] == b"IM" else ">"
        while len(tag := file.read(8)) == 8:
            kind, size = struct.unpack(f"{order}II", tag)
            begin = file.tell()
            data = file.read(min(size, _ENOUGH))
            packed = kind == _COMPRESSED
            if packed:
                data = zlib.decompressobj().decompress(data, _ENOUGH)
                kind, data = struct.unpack(f"{order}I", data[:4])[0], data[8:]
            if kind == _MATRIX:
                found.append(replace(_variable(data, order), begin=begin, size=size, packed=packed))
            file.seek(begin + size)
    return found


def unpacked_bytes(path: Path, name: str, most: int) -> int:
    """Return how many bytes the variables of that name unpack to, or a number above `most` once it is more.

    Nothing of them is kept. Raises as `variables_in`.
    """
    total = 0
    with path.open("rb") as file:
        for one in variables_in(path):
            if one.name != name:
                continue
            if not one.packed:
                total += one.size
                continue
            file.seek(one.begin)
            unpacker, left = zlib.decompressobj(), one.size
            while total <= most and not unpacker.eof:
                data = unpacker.unconsumed_tail
                if not data:
                    data = file.read(min(left, _BLOCK))
                    left -= len(data)
                if not data:
                    break
                total += len(unpacker.decompress(data, _BLOCK))
    return total


def _variable(data: bytes, order: str) -> Variable:
    """Return what the beginning of an element tells."""
    flags, rest = _part(data, order)
    kind = struct.unpack(f"{order}I", flags[:4])[0] & 0xFF
    if kind == _OPAQUE:
        texts = []
        for _ in range(3):
            text, rest = _part(rest, order)
            texts.append(text.decode("latin-1"))
        return Variable(texts[0], (), texts[2] or "object")
    lengths, rest = _part(rest, order)
    name, _ = _part(rest, order)
    shape = struct.unpack(f"{order}{len(lengths) // 4}i", lengths[: len(lengths) // 4 * 4])
    return Variable(name.decode("latin-1"), shape, is_structure=kind == _STRUCTURE)


def _part(data: bytes, order: str) -> tuple[bytes, bytes]:
    """Return the first part of an element, and what follows it; of four bytes or fewer it is in its own tag."""
    if len(data) < 8:
        raise ValueError("an element ends within its tag")
    (kind,) = struct.unpack(f"{order}I", data[:4])
    if kind >> 16:
        return data[4 : 4 + (kind >> 16)], data[8:]
    (size,) = struct.unpack(f"{order}I", data[4:8])
    return data[8 : 8 + size], data[8 + size + -size % 8 :]


def class_of(found: h5py.Dataset | h5py.Group) -> str | None:
    """Return the class of what stands for an object in a file of version 7.3, None for plain numbers."""
    if not h5py.h5a.exists(found.id, DECODED.encode()):
        return None
    told = found.attrs.get("MATLAB_class", b"object")
    return told.decode("latin-1") if isinstance(told, bytes) else str(told)


def refusal(path: Path, name: str, kind: str) -> DataError:
    """Return the error for an object, which cannot be read, with what to do in MATLAB."""
    numbers = "double" if kind in ("single", "string", "categorical") else "seconds or posixtime"
    how = {
        "timetable": f"T = timetable2table({name}); T.Time = seconds(T.Time - T.Time(1)); s = table2struct(T, "
        "'ToScalar', true); save('plain.mat', '-struct', 's')",
        "table": f"s = table2struct({name}, 'ToScalar', true); save('plain.mat', '-struct', 's')",
    }.get(kind, f"convert it to numbers (with {numbers}, say) and save these")
    return DataError(f"{path}: '{name}' is a MATLAB {kind}, which only MATLAB can read: in MATLAB, {how}")
