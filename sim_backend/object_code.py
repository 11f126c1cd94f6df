"""Loads object code without LLVM, whose own loading takes longer than all else that a new process does to play.

It reads the part of the format that LLVM writes on x86-64 under Linux when it compiles for any distance in memory:
constants of the code and functions of the C library have whole addresses. Anything else is left to LLVM. Source: System
V ABI, chapter 4 of the generic part and of that for AMD64.
"""

from __future__ import annotations

import ctypes
import mmap
import struct
from functools import cache
from typing import Any, NamedTuple

_WANTED = b"\x7fELF\x02\x01\x01", 1, 62
"""Magic number of 64 bits with the lowest byte first, kind of file (to be linked), processor."""
_HEADER, _SECTION = struct.Struct("<7s9xHH20xQ10xHHH"), struct.Struct("<IIQQQQIIQQ")
_SYMBOL, _RELOCATION, _ADDRESS = struct.Struct("<IBBHQQ"), struct.Struct("<QIIq"), struct.Struct("<Q")
_BYTES, _SYMBOLS, _RELOCATIONS = 1, 2, 4
_WRITTEN, _IN_MEMORY, _OF_A_THREAD = 0x1, 0x2, 0x400
_ELSEWHERE, _WHOLE_ADDRESS = 0, 1
_UNWINDING = b".eh_frame"
"""Section for exceptions, which no kernel raises."""


class Linked(NamedTuple):
    """The address of a function in this process, and what holds its code, which must live as long."""

    address: int
    held: Any


class _UnknownError(Exception):
    """The code holds what is not known here, or the system grants no memory for it."""


class _Section(NamedTuple):
    name: bytes
    kind: int
    flags: int
    data: bytes
    names: int
    about: int
    alignment: int


def in_memory(code: bytes, name: str) -> Linked | None:
    """Return the function `name` of object code, ready to be called; None where LLVM has to load it."""
    try:
        image = _Image(code)
        return Linked(image.finished(name.encode()), image)
    except _UnknownError:
        return None


class _Image:
    """Object code at its address in memory."""

    def __init__(self, code: bytes) -> None:
        self._sections = _sections(code)
        (table,) = (section for section in self._sections if section.kind == _SYMBOLS)
        names = self._sections[table.names].data
        self._symbols = [
            (_text(names, at), section, value) for at, _, _, section, value, _ in _SYMBOL.iter_unpack(table.data)
        ]
        self._starts, size = _layout(self._sections)
        self._memory = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        self._base = ctypes.addressof(ctypes.c_char.from_buffer(self._memory))
        for i, start in self._starts.items():
            self._memory[start : start + len(self._sections[i].data)] = self._sections[i].data

    def finished(self, name: bytes) -> int:
        """Write all addresses that the code holds, let it be executed, and return that of a function."""
        for table in self._sections:
            if table.about in self._starts and table.kind == _RELOCATIONS:
                for at, kind, symbol, more in _RELOCATION.iter_unpack(table.data):
                    if kind != _WHOLE_ADDRESS:
                        raise _UnknownError
                    _ADDRESS.pack_into(self._memory, self._starts[table.about] + at, self._address(symbol) + more)
        # from here on it cannot be written
        allowed = ctypes.c_int(mmap.PROT_READ | mmap.PROT_EXEC)
        if _process().mprotect(ctypes.c_void_p(self._base), ctypes.c_size_t(len(self._memory)), allowed):
            raise _UnknownError
        return self._address([symbol[0] for symbol in self._symbols].index(name))

    def _address(self, symbol: int) -> int:
        name, section, value = self._symbols[symbol]
        if section == _ELSEWHERE:
            return _of_the_process(name.decode())
        if section not in self._starts:
            raise _UnknownError
        return self._base + self._starts[section] + value


def _sections(code: bytes) -> list[_Section]:
    if len(code) < _HEADER.size:
        raise _UnknownError
    magic, kind, processor, at, size, count, of_names = _HEADER.unpack_from(code)
    if (magic, kind, processor) != _WANTED or size != _SECTION.size:
        raise _UnknownError
    rows = list(_SECTION.iter_unpack(code[at : at + size * count]))
    names = code[rows[of_names][4] :]
    return [
        _Section(_text(names, name), kind, flags, code[start : start + length], linked, about, max(alignment, 1))
        for name, kind, flags, _, start, length, linked, about, alignment, _ in rows
    ]


def _layout(sections: list[_Section]) -> tuple[dict[int, int], int]:
    """Return where those sections begin that the code needs in memory, by their number, and the size of all."""
    starts, end = {}, 1
    for i, section in enumerate(sections):
        if section.flags & _IN_MEMORY and section.name != _UNWINDING:
            if section.kind != _BYTES or section.flags & (_WRITTEN | _OF_A_THREAD):
                raise _UnknownError
            starts[i] = -(-end // section.alignment) * section.alignment
            end = starts[i] + len(section.data)
    return starts, end


def _text(names: bytes, at: int) -> bytes:
    return names[at : names.index(b"\0", at)]


def _of_the_process(name: str) -> int:
    """Return the address of a function of the C library, the one that LLVM finds."""
    try:
        return ctypes.cast(getattr(_process(), name), ctypes.c_void_p).value or 0
    except AttributeError:
        raise _UnknownError from None


@cache
def _process() -> ctypes.CDLL:
    return ctypes.CDLL(None)
